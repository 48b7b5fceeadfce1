/** Projections round the turn, with the features that were followed. */

const FRAME_MS = 110;
const DOT = 3.2; // px of the screen
const COLOURS = ["#35b779", "#9bd93c", "#fde725", "#f8961e", "#f94144"];
const PLAIN = "#ffb000";

class Player {
  constructor(root, spec) {
    this.spec = spec;
    this.at = 0;
    this.options = { tails: true, residuals: spec.tracks?.residual != null };
    this.frames = spec.frames.map((source) => Object.assign(new Image(), { src: source }));
    this.build(root);
    this.load();
  }

  async load() {
    if (this.spec.tracks) this.tracks = await unpackedTracks(this.spec.tracks);
    await this.frames[0].decode();
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    this.canvas.dataset.ready = "true";
    this.show(0);
  }

  build(root) {
    const { spec } = this;
    this.canvas = element("canvas", { tabindex: 0, role: "img", "aria-label": "projection with the features seen in it",
      style: `aspect-ratio: ${spec.width} / ${spec.height}; max-height: 70vh; max-width: calc(70vh * ${spec.width} / ${spec.height}); margin: auto` });
    this.said = element("output", { "aria-live": "off" });
    this.play = element("button", { type: "button", "aria-pressed": "false", onclick: () => this.toggle() }, "▶ play");
    this.seek = slider("angle", { min: 0, max: spec.frames.length - 1, step: 1 }, (k) => {
      this.stop();
      this.show(k);
    });
    const controls = element("div", { class: "controls" }, this.play, this.seek);
    if (spec.tracks) controls.append(this.tick("tails", "tracks, some degrees before and after"));
    if (spec.tracks?.residual) {
      controls.append(this.tick("residuals", "coloured by residual"));
      this.key = element("div", { class: "legend" });
      controls.append(this.key);
    }
    if (spec.frames.length < 2) {
      this.play.hidden = true;
      this.seek.hidden = true;
    }
    root.append(element("div", { class: "stage" }, this.canvas, this.said), controls);
    root.addEventListener("keydown", (event) => this.press(event));
  }

  tick(option, label) {
    const box = element("input", { type: "checkbox", checked: this.options[option], onchange: () => {
      this.options[option] = box.checked;
      this.draw();
    } });
    return element("label", {}, box, ` ${label}`);
  }

  press(event) {
    if (event.target.matches("input, button")) return;
    const act = {
      " ": () => this.toggle(),
      ArrowLeft: () => this.step(-1),
      ArrowRight: () => this.step(1),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  toggle() {
    if (this.timer) this.stop();
    else this.timer = setInterval(() => this.show((this.at + 1) % this.frames.length), FRAME_MS);
    this.play.setAttribute("aria-pressed", String(Boolean(this.timer)));
    this.play.textContent = this.timer ? "❚❚ pause" : "▶ play";
  }

  stop() {
    if (!this.timer) return;
    clearInterval(this.timer);
    this.timer = null;
    this.play.setAttribute("aria-pressed", "false");
    this.play.textContent = "▶ play";
  }

  step(by) {
    this.stop();
    this.show((this.at + by + this.frames.length) % this.frames.length);
  }

  show(k) {
    this.at = k;
    this.seek.tell(k, `${number(this.spec.angles[k])}°`);
    this.draw();
  }

  draw() {
    const frame = this.frames[this.at];
    if (!frame.complete) {
      frame.onload = () => this.draw();
      return;
    }
    const dense = window.devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    Object.assign(this.canvas, { width: width * dense, height: height * dense });
    const pen = this.canvas.getContext("2d");
    pen.scale(dense, dense);
    pen.drawImage(frame, 0, 0, width, height);
    const seen = this.tracks ? this.drawTracks(pen, width / this.spec.width, height / this.spec.height) : null;
    const features = seen === null ? "" : ` · ${seen} features`;
    this.said.textContent = `${this.spec.names[this.at]}${features}`;
  }

  /** Draw what is seen in this projection, and where it is a little before and after; return how many. */
  drawTracks(pen, across, along) {
    const { feature, rank, column, row, residual, worst } = this.tracks;
    const now = this.spec.ranks[this.at];
    const near = (k) => Math.abs(rank[k] - now) <= (this.options.tails ? this.spec.tail / 2 : 0);
    const spot = (k) => [(column[k] + 0.5) * across, (row[k] + 0.5) * along];
    let seen = 0;
    pen.lineWidth = 1.2;
    for (let k = 0; k < rank.length; k += 1) {
      if (rank[k] !== now) continue;
      seen += 1;
      const colour = this.options.residuals ? COLOURS[shade(residual[k], worst)] : PLAIN;
      pen.fillStyle = pen.strokeStyle = colour;
      pen.beginPath();
      pen.arc(...spot(k), DOT, 0, 2 * Math.PI);
      pen.fill();
      let at = k;
      while (at > 0 && feature[at - 1] === feature[k] && near(at - 1)) at -= 1;
      pen.beginPath();
      for (; feature[at] === feature[k] && near(at); at += 1) pen.lineTo(...spot(at));
      pen.stroke();
    }
    this.tellColours(worst);
    return seen;
  }

  tellColours(worst) {
    if (!this.key) return;
    this.key.hidden = !this.options.residuals;
    if (this.key.hidden || this.key.childElementCount) return;
    COLOURS.forEach((colour, k) => {
      const from = number((worst * k) / COLOURS.length, 2);
      const words = k === COLOURS.length - 1 ? `over ${from} px` : `from ${from} px`;
      this.key.append(element("span", {}, element("i", { class: "box", style: `color: ${colour}; opacity: 1` }), words));
    });
  }
}

async function unpackedTracks(packed) {
  const [feature, rank, column, row] = await Promise.all([
    inflated(packed.feature).then((bytes) => new Int32Array(bytes)),
    inflated(packed.rank).then((bytes) => new Int32Array(bytes)),
    inflated(packed.column).then((bytes) => new Float32Array(bytes)),
    inflated(packed.row).then((bytes) => new Float32Array(bytes)),
  ]);
  const residual = packed.residual ? new Float32Array(await inflated(packed.residual)) : null;
  const sizes = residual ? [...residual].map(Math.abs).sort((a, b) => a - b) : [1];
  // Nine in ten share the first colours; what is worse stands out.
  return { feature, rank, column, row, residual, worst: sizes[Math.floor(0.9 * (sizes.length - 1))] || 1 };
}

/** Number of the colour of a residual, px. */
function shade(residual, worst) {
  return clamp(Math.floor((Math.abs(residual) / worst) * COLOURS.length), 0, COLOURS.length - 1);
}
