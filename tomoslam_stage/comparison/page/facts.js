/** Everything that is told in words and numbers. */

const ANGLES = ["recorded", "refined", "true"];

function put(id, text) {
  document.getElementById(id).textContent = text ?? "";
}

function tellVerdict() {
  const { report, verdict } = page;
  const status = document.getElementById("status");
  status.textContent = report.status;
  status.classList.add(report.status);
  put("scan", report.scan.name);
  put("verdict", verdict.charAt(0).toUpperCase() + verdict.slice(1));
  put("reason", report.reason);
  put("gauge", report.gauge ? `Not seen by any scan: ${report.gauge}.` : "");
}

/** The numbers a reader looks for first; unknown ones are left out. */
function tellTiles() {
  const { report } = page;
  const moved = report.proposed_max_change_deg > 0;
  const gain = report.comparison.residual_gain_percent;
  const { errors } = report.comparison;
  const where = report.comparison.heldout_rows.length ? "unused rows" : "the rows used";
  const tiles = {
    [`correction${report.status === "accepted" ? "" : " found"}, rms and most`]: moved
      && `${number(report.proposed_rms_change_deg, 3)}°, ${number(report.proposed_max_change_deg, 3)}°`,
    "median sigma": report.median_sigma_deg !== null && `${number(report.median_sigma_deg, 2)}°`,
    [`residual, ${where}`]: moved && gain !== null && `${gain > 0 ? "−" : "+"}${number(Math.abs(gain), 3)} %`,
    "true error, rms": "error_ratio" in errors && moved && `${number(errors.recorded_rms_deg, 2)}° → ${number(errors.refined_rms_deg, 2)}°`,
    // Those that were left out, and are not drawn, would only puzzle.
    features: page.movie.tracks && report.n_features && String(report.n_features),
    "axis, detector column": report.axis_px !== null && `${number(report.axis_px, 6)} px`,
  };
  const shown = Object.entries(tiles).filter(([, value]) => value);
  document.getElementById("tiles").append(...shown.map(([name, value]) =>
    element("div", {}, element("dt", {}, name), element("dd", {}, value))));
}

function tellMeasures() {
  const { measures } = page;
  const told = ANGLES.filter((name) => measures.some((measure) => measure.values[name] != null));
  const heads = ["", ...told, "better", "what it means"];
  const head = heads.map((name, k) => element("th", { scope: "col", class: k > 0 && k <= told.length ? "number" : null }, name));
  const rows = measures.map((measure) => {
    const [recorded, refined] = [measure.values.recorded, measure.values.refined];
    const best = recorded == null || refined == null || recorded === refined ? null
      : (refined < recorded) === (measure.better === "less") ? "refined" : "recorded";
    const cells = told.map((name) => element("td", {
      class: `number${name === best ? " best" : ""}${measure.values[name] == null ? " absent" : ""}`, "data-of": name,
    }, number(measure.values[name])));
    const unit = measure.unit ? [" ", element("small", {}, measure.unit)] : [];
    const arrow = measure.better === "less" ? "↓ less" : "↑ more";
    const decides = measure.decides ? [element("span", { class: "decides" }, "Decides. ")] : [];
    return element("tr", {}, element("th", { scope: "row" }, measure.name, ...unit), ...cells,
      element("td", { class: "better" }, arrow), element("td", { class: "words" }, ...decides, measure.note));
  });
  document.getElementById("measures").append(
    element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...rows));
}

function tellFacts(id, facts) {
  const rows = Object.entries(facts).filter(([, value]) => value !== null && value !== undefined && value !== "");
  document.getElementById(id).append(...rows.map(([name, value]) =>
    element("tr", {}, element("th", { scope: "row" }, name), element("td", {}, String(value)))));
}

function tellOrigin() {
  const { report } = page;
  const { scan, stage } = report;
  const [projections, rows, columns] = scan.shape;
  const seconds = Object.entries(report.seconds).sort((a, b) => b[1] - a[1]);
  const total = seconds.reduce((sum, [, each]) => sum + each, 0);
  const walk = stage.walk_deg === null ? null
    : `walk ${number(stage.walk_deg, 2)}° a step, jitter ${number(stage.jitter_deg, 2)}°`;
  tellFacts("run", {
    scan: scan.file ?? scan.name,
    started: report.started,
    size: `${projections} projections of ${rows} × ${columns} px${scan.binning > 1 ? `, binned ${scan.binning} × ${scan.binning}` : ""}`,
    "frames left out": Object.entries(scan.left_out).map(([frame, why]) => `${frame} (${why})`).join(", "),
    "encoder error": walk,
    "roll of the axis": stage.roll_deg === null ? null : `${number(stage.roll_deg, 2)}°`,
    "shifts of projections": stage.shift_px === null ? null : `${number(stage.shift_px, 2)} px rms`,
    ...Object.fromEntries(Object.entries(report.sources).map(([name, note]) => [name, note])),
    sightings: report.n_sightings,
    took: total ? `${number(total, 3)} s: ${seconds.map(([name, each]) => `${name} ${each.toFixed(1)}`).join(", ")}` : null,
  });
  tellFacts("versions", Object.fromEntries(
    Object.entries(report.versions).map(([name, version]) => [name, version ?? "not installed"])));
  copied("logbook", report.logbook_line);
  copied("pipeline", page.pipeline);
}

/** Show a text with a button that copies it; the clipboard may be closed to pages from disk. */
function copied(id, text) {
  const box = document.getElementById(id);
  if (!text) return;
  box.hidden = false;
  const code = [...box.querySelectorAll("code")].at(-1);
  code.textContent = text;
  const button = box.querySelector("button");
  button.setAttribute("aria-label", `copy: ${box.querySelector("h3").textContent}`);
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "copied";
    } catch {
      getSelection().selectAllChildren(code);
      button.textContent = document.execCommand("copy") ? "copied" : "selected: press Ctrl+C";
    }
  });
}
