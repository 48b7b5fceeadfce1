/** Show every section that there is something to say in. */

function section(id, there, fill) {
  const box = document.getElementById(id);
  box.hidden = !there;
  if (there) fill(box);
  return there;
}

function charts(box, specs) {
  for (const spec of specs) new Chart(box.querySelector(".charts"), spec);
}

function showTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  const follow = () => { root.dataset.theme = dark.matches ? "dark" : "light"; };
  dark.addEventListener("change", follow);
  follow();
  document.getElementById("theme").addEventListener("click", () => {
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
  });
}

function showAngles(box) {
  const slots = box.querySelectorAll(".chart-slot");
  [page.correction, page.shifts, page.residuals].forEach((spec, k) => {
    if (spec) new Chart(slots[k], spec);
  });
  const marks = page.correction?.marks ?? [];
  const events = document.getElementById("events");
  events.hidden = !marks.length;
  events.append(...marks.map((mark) => element("li", {}, mark.label)));
}

function showFeatures(box) {
  const { tracks, frames } = page.movie;
  const few = tracks && tracks.every > 1 ? ` One feature in ${tracks.every} is drawn.` : "";
  const seen = tracks ? `${tracks.features} features in ${tracks.sightings} sightings.${few}` : "No features were followed far enough to be used.";
  put("features-note", `${frames.length} projections in the order of their angles; bright is what attenuates more. ${seen}`);
  new Player(box.querySelector(".player"), page.movie);
  charts(box, page.track_charts);
}

function showAll() {
  showTheme();
  tellVerdict();
  tellTiles();
  section("slices", page.slices, (box) => {
    const [factor] = page.slices.stacks[0].pixel;
    const shrunk = factor > 1 ? ` ${factor} × ${factor} px are drawn as one, but for the square that changed most.` : "";
    put("slices-note", `All on one grey scale. Bright is what attenuates more; each set of angles has the axis that suits it best.${shrunk}`);
    new Viewer(box.querySelector(".viewer"), page.slices, "slices from recorded and refined angles", "wipe");
    charts(box, page.slice_charts);
  });
  section("angles", page.correction || page.residuals, showAngles);
  section("features", true, showFeatures);
  section("sinogram", page.sinogram, (box) => {
    put("row", `Shown: ${page.sinogram.row}.`);
    new Viewer(box.querySelector(".viewer"), page.sinogram, "sinogram with recorded and refined angles", "side");
  });
  section("numbers", page.measures.length, tellMeasures);
  tellOrigin();
  const shown = [...document.querySelectorAll("section")].filter((box) => !box.hidden);
  document.getElementById("contents").append(...shown.map((box) =>
    element("a", { href: `#${box.id}` }, box.querySelector("h2").textContent)));
}

showAll();
