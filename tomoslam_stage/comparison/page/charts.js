/** Curves, bands and bars with their axes; the value under the pointer is told. */

const MARGIN = { left: 58, right: 14, top: 18, bottom: 40 };
const CHART_HEIGHT = 270;

class Chart {
  constructor(root, spec) {
    this.spec = spec;
    this.lines = spec.series.filter((series) => series.kind === "line");
    this.bars = spec.series.find((series) => series.kind === "bars");
    this.band = spec.series.find((series) => series.kind === "band");
    this.main = this.bars ?? this.lines[0];
    this.at = null;
    this.drawing = drawn("svg", { height: CHART_HEIGHT, tabindex: 0, role: "img", "aria-label": this.summary() });
    this.tip = element("div", { class: "tip", role: "status", hidden: true });
    const remark = spec.remark ? [element("small", {}, spec.remark)] : [];
    root.append(element("figure", {}, element("figcaption", {}, spec.title, ...remark), this.legend(), this.drawing, this.tip));
    new ResizeObserver(() => this.draw()).observe(this.drawing);
    this.listen();
  }

  summary() {
    const names = this.spec.series.map((series) => series.label).join(", ");
    return `${this.spec.title}: ${names}; arrow keys tell the values`;
  }

  legend() {
    const entries = this.spec.series.map((series) => {
      const box = series.kind === "line" ? "" : " box";
      return element("span", {}, element("i", { class: `${series.style}${box}` }), series.label);
    });
    return element("div", { class: "legend" }, ...entries);
  }

  /** Range of x and of y that everything drawn lies in. */
  ranges() {
    const xs = this.bars ? this.bars.edges : this.lines.flatMap((series) => series.x);
    const ys = this.spec.series.filter((series) => series.y).flatMap((series) => series.y);
    if (this.band) this.main.y.forEach((y, k) => ys.push(y - 2 * this.band.width[k], y + 2 * this.band.width[k]));
    if (this.bars || this.spec.zero) ys.push(0);
    const positive = this.spec.logarithmic ? ys.filter((y) => y > 0) : ys;
    const x = range(xs, 0);
    const y = this.spec.logarithmic ? range(positive.map(Math.log10), 0.05) : range(positive, 0.05);
    return { x, y: this.bars ? [0, y[1]] : y };
  }

  draw() {
    const width = this.drawing.clientWidth;
    if (!width) return;
    const { x, y } = this.ranges();
    const right = width - MARGIN.right;
    const bottom = CHART_HEIGHT - MARGIN.bottom;
    const logged = this.spec.logarithmic ? (value) => Math.log10(Math.max(value, 1e-300)) : (value) => value;
    this.across = scale(x, [MARGIN.left, right]);
    const up = scale(y, [bottom, MARGIN.top]);
    this.up = (value) => up(logged(value));
    this.drawing.setAttribute("viewBox", `0 0 ${width} ${CHART_HEIGHT}`);
    this.cursor = drawn("line", { class: "cursor", y1: MARGIN.top, y2: bottom, visibility: "hidden" });
    this.drawing.replaceChildren(...this.axes(x, y, right, bottom), ...this.shapes(), ...this.marks(bottom), this.cursor);
    if (this.at !== null) this.tell(this.at);
  }

  axes(x, y, right, bottom) {
    const made = [];
    for (const value of ticks(x, Math.max(3, (right - MARGIN.left) / 90))) {
      const at = this.across(value);
      made.push(drawn("line", { class: "grid", x1: at, x2: at, y1: MARGIN.top, y2: bottom }));
      made.push(drawn("text", { x: at, y: bottom + 16, "text-anchor": "middle" }, number(value)));
    }
    const decades = this.spec.logarithmic ? ticks(y, 4).map((value) => 10 ** value) : ticks(y, 5);
    for (const value of decades) {
      const at = this.up(value);
      made.push(drawn("line", { class: "grid", x1: MARGIN.left, x2: right, y1: at, y2: at }));
      made.push(drawn("text", { x: MARGIN.left - 6, y: at + 4, "text-anchor": "end" }, number(value, this.spec.logarithmic ? 3 : 4)));
    }
    if (this.spec.zero) {
      made.push(drawn("line", { class: "zero", x1: MARGIN.left, x2: right, y1: this.up(0), y2: this.up(0) }));
    }
    const [below, beside] = this.spec.labels;
    made.push(drawn("text", { x: (MARGIN.left + right) / 2, y: CHART_HEIGHT - 6, "text-anchor": "middle" }, below));
    made.push(drawn("text", { x: 4, y: 12 }, beside));
    return made;
  }

  shapes() {
    const made = [];
    if (this.band) for (const k of [2, 1]) made.push(drawn("path", { class: "band", d: this.bandPath(k) }));
    if (this.bars) {
      this.bars.y.forEach((count, k) => {
        const [from, to] = [this.across(this.bars.edges[k]), this.across(this.bars.edges[k + 1])];
        const top = this.up(count);
        made.push(drawn("rect", { class: "bar", x: from, y: top, width: Math.max(to - from - 0.5, 0.5), height: this.up(0) - top }));
      });
    }
    // What is drawn last lies on top: the first curve is the one that matters.
    for (const series of [...this.lines].reverse()) {
      made.push(drawn("path", { class: `curve ${series.style}`, d: this.path(series.x, series.y) }));
    }
    return made;
  }

  path(xs, ys) {
    let pen = "M";
    return ys.map((y, k) => {
      if (y === null || xs[k] === null) {
        pen = "M";
        return "";
      }
      const point = `${pen}${this.across(xs[k]).toFixed(1)} ${this.up(y).toFixed(1)}`;
      pen = "L";
      return point;
    }).join("");
  }

  /** Closed outline of so many sigma; there is none where sigma is not known. */
  bandPath(sigmas) {
    const { x, y } = this.main;
    const known = x.map((_, k) => k).filter((k) => y[k] !== null && this.band.width[k] !== null);
    const edge = (k, sign) => `${this.across(x[k]).toFixed(1)} ${this.up(y[k] + sign * sigmas * this.band.width[k]).toFixed(1)}`;
    const outline = [...known.map((k) => edge(k, 1)), ...known.reverse().map((k) => edge(k, -1))];
    return outline.length ? `M${outline.join("L")}Z` : "";
  }

  marks(bottom) {
    return (this.spec.marks ?? []).flatMap((mark, k) => {
      const at = this.across(mark.x);
      return [
        drawn("line", { class: "mark", x1: at, x2: at, y1: MARGIN.top, y2: bottom }, drawn("title", {}, mark.label)),
        drawn("text", { class: "mark-name", x: at, y: MARGIN.top - 5, "text-anchor": "middle" }, String(k + 1)),
      ];
    });
  }

  listen() {
    const { drawing } = this;
    drawing.addEventListener("pointermove", (event) => this.point(event));
    drawing.addEventListener("pointerleave", () => this.hush());
    drawing.addEventListener("blur", () => this.hush());
    drawing.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10 }[event.key];
      if (!step) return;
      event.preventDefault();
      const last = this.main.x.length - 1;
      this.tell(clamp(this.at === null ? 0 : this.at + step, 0, last));
    });
  }

  point(event) {
    const x = event.clientX - this.drawing.getBoundingClientRect().left;
    let best = 0;
    this.main.x.forEach((value, k) => {
      if (value !== null && Math.abs(this.across(value) - x) < Math.abs(this.across(this.main.x[best]) - x)) best = k;
    });
    this.tell(best);
  }

  /** Say all values at the `k`th place. */
  tell(k) {
    this.at = k;
    const x = this.main.x[k];
    if (x === null) return;
    const lines = [this.spec.items?.[k] ?? null, `${this.spec.labels[0]}: ${number(x)}`];
    for (const series of [this.bars, ...this.lines].filter(Boolean)) {
      const sigma = this.band && series === this.main ? ` ± ${number(this.band.width[k], 2)}` : "";
      const at = series === this.main || series.x.length === this.main.x.length ? k : null;
      if (at !== null) lines.push(`${series.label}: ${number(series.y[at])}${sigma}`);
    }
    this.tip.textContent = lines.filter((text) => text !== null).join("\n");
    this.tip.hidden = false;
    const place = this.across(x);
    const left = place < this.drawing.clientWidth / 2;
    this.tip.style.left = left ? `${place + 12}px` : "auto";
    this.tip.style.right = left ? "auto" : `${this.drawing.clientWidth - place + 12}px`;
    this.tip.style.top = `${this.drawing.offsetTop + MARGIN.top}px`;
    for (const end of ["x1", "x2"]) this.cursor.setAttribute(end, place);
    this.cursor.setAttribute("visibility", "visible");
  }

  hush() {
    this.at = null;
    this.tip.hidden = true;
    this.cursor?.setAttribute("visibility", "hidden");
  }
}

/** Smallest and largest of `values`, and a little room at either end. */
function range(values, room) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null || !Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) return [0, 1];
  const more = high > low ? (high - low) * room : Math.abs(high) || 1;
  return [low - more, high + more];
}

function scale([from, to], [start, end]) {
  return (value) => start + ((value - from) / (to - from)) * (end - start);
}

/** About `count` round numbers within a range. */
function ticks([low, high], count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((each) => each >= rough);
  const made = [];
  for (let k = Math.ceil(low / step); k * step <= high + step * 1e-9; k += 1) made.push(k * step);
  return made;
}
