/** Two pictures of the same thing under one slider, with linked zoom, blink and difference. */

const ZOOM_STEP = 1.4;
const MOST_ZOOM = 40;
const GRIP = 24; // px to either side of the divider that take hold of it
const BLINK_MS = 700;
const MODES = { wipe: "wipe", side: "side by side", blink: "blink", difference: "difference" };
const KEYS = {
  move: ["←  →  ↑  ↓", "move the picture when zoomed in"],
  compare: ["←  →  [  ]", "move the divider"],
  blink: ["b", "swap the two (blink by hand)"],
  views: ["w  s  d", "wipe, side by side, difference"],
  zoom: ["+  −  0", "zoom in, out, fit"],
  focus: ["f", "go to what changed most"],
  next: ["n", "next picture"],
};

class Viewer {
  constructor(root, spec, title, mode) {
    this.spec = spec;
    this.names = Object.keys(spec.names);
    this.pair = [this.names[0], this.names[1] ?? this.names[0]];
    this.mode = this.names.length > 1 ? mode : "single";
    this.split = 0.5;
    this.swapped = false;
    this.root = root;
    this.build(title);
    this.show(spec.first);
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  get compares() {
    return this.names.length > 1;
  }

  /** Which keys have something to do. */
  get uses() {
    const { compares } = this;
    const { stacks } = this.spec;
    return { compare: compares, blink: compares, views: compares, next: stacks.length > 1, focus: stacks.some((stack) => stack.focus) };
  }

  build(title) {
    this.canvas = element("canvas", { tabindex: 0, role: "img", "aria-label": title });
    this.left = element("span", { class: "name left" });
    this.right = element("span", { class: "name right" });
    this.said = element("output", { "aria-live": "off" });
    this.wiper = slider("divider", { min: 0, max: 100, class: "wipe" }, (value) => this.wipe(value / 100));
    this.wiper.hidden = !this.compares;
    const stage = element("div", { class: "stage" }, this.canvas, this.left, this.right, this.said, this.wiper);
    this.root.append(stage, this.controls());
    this.listen();
  }

  controls() {
    const { stacks } = this.spec;
    const made = [];
    this.picker = list("picture", stacks.map((stack) => stack.label), this.spec.first, (k) => this.show(k));
    if (stacks.length > 1) made.push(this.picker);
    if (this.compares) {
      this.modes = choice("view", MODES, this.mode, (mode) => this.enter(mode));
      made.push(this.modes);
    }
    if (this.names.length > 2) {
      const labels = Object.values(this.spec.names);
      for (const [side, k] of [["left", 0], ["right", 1]]) {
        made.push(list(side, labels, k, (chosen) => this.choose(k, this.names[chosen])));
      }
    }
    this.low = slider("black", {}, (value) => this.setWindow(value, this.window[1]));
    this.high = slider("white", {}, (value) => this.setWindow(this.window[0], value));
    const auto = element("button", { type: "button", onclick: () => this.setWindow(...this.stack.window) }, "auto");
    const full = element("button", { type: "button", onclick: () => this.setWindow(...this.stack.limits) }, "full range");
    this.grey = element("fieldset", {}, element("legend", {}, `grey scale, ${this.spec.unit}`), this.low, this.high,
      element("div", { class: "row" }, auto, full));
    this.reach = slider("difference shown up to ±", {}, (value) => this.setReach(value));
    made.push(this.grey, this.reach, this.zooms(), keyList(this.uses));
    return element("div", { class: "controls" }, ...made);
  }

  zooms() {
    const button = (label, name, act) => element("button", { type: "button", "aria-label": name, onclick: act }, label);
    const row = element("div", { class: "row" },
      button("−", "zoom out", () => this.zoomBy(1 / ZOOM_STEP)),
      button("+", "zoom in", () => this.zoomBy(ZOOM_STEP)),
      button("fit", "fit the whole picture", () => this.fit()));
    if (this.uses.focus) {
      row.append(button("most changed", "go to what changed most", () => this.focus()));
    }
    return element("fieldset", {}, element("legend", {}, "zoom"), row);
  }

  /** Show stack `k`; its pixels are unpacked when they are first needed. */
  async show(k) {
    const stack = this.spec.stacks[k];
    this.at = k;
    this.parts ??= new Map();
    if (!this.parts.has(stack)) this.parts.set(stack, await unpacked(stack));
    if (this.at !== k) return;
    const fresh = this.stack === undefined || !sameSize(this.stack, stack);
    this.stack = stack;
    const [low, high] = stack.window;
    const reach = high - low;
    const ends = [Math.max(stack.limits[0], low - reach), Math.min(stack.limits[1], high + reach)];
    for (const end of [this.low, this.high]) Object.assign(end.input, { min: ends[0], max: ends[1] });
    Object.assign(this.reach.input, { min: reach / 200, max: reach });
    if (fresh) this.fit();
    this.setReach(reach / 8);
    this.setWindow(low, high);
    this.enter(this.mode);
    this.canvas.dataset.ready = "true";
  }

  enter(mode) {
    clearInterval(this.timer);
    this.mode = mode;
    this.swapped = false;
    this.modes?.press(mode);
    this.grey.hidden = mode === "difference";
    this.reach.hidden = mode !== "difference";
    this.wiper.hidden = mode !== "wipe";
    const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (mode === "blink" && !calm) this.timer = setInterval(() => this.swap(), BLINK_MS);
    this.wipe(this.split);
    this.name();
  }

  swap() {
    this.swapped = !this.swapped;
    this.name();
    this.draw();
  }

  choose(side, name) {
    this.pair[side] = name;
    this.paint();
    this.name();
  }

  /** Say what is seen on which side. */
  name() {
    const [first, second] = this.pair.map((name) => this.spec.names[name]);
    const alone = { single: first, blink: this.swapped ? second : first, difference: `${second} − ${first}` };
    this.left.textContent = alone[this.mode] ?? first;
    this.right.textContent = this.mode in alone ? "" : second;
    this.right.hidden = this.mode in alone;
  }

  wipe(share) {
    this.split = clamp(share, 0, 1);
    const percent = Math.round(100 * this.split);
    this.wiper.tell(100 * this.split, `${percent} %`);
    this.draw();
  }

  setWindow(low, high) {
    const least = (this.stack.limits[1] - this.stack.limits[0]) / 5000;
    this.window = low + least > high ? [Math.min(low, high), Math.min(low, high) + least] : [low, high];
    this.low.tell(this.window[0], number(this.window[0]));
    this.high.tell(this.window[1], number(this.window[1]));
    this.paint();
  }

  setReach(value) {
    this.most = value;
    this.reach.tell(value, number(value, 3));
    this.paint();
  }

  /** Turn greys into pixels, for all pictures of the stack. */
  paint() {
    if (!this.window) return;
    const table = greyTable(this.window, this.stack.limits);
    for (const part of this.parts.get(this.stack)) {
      for (const name of new Set(this.pair)) part.canvas[name] = painted(part, part.greys[name], table);
      part.canvas.difference = this.compares ? difference(part, this.pair, this.most) : null;
    }
    this.draw();
  }

  fit() {
    const [width, height] = extent(this.stack);
    this.view = { x: width / 2 - 0.5, y: height / 2 - 0.5, zoom: 1 };
    this.draw();
  }

  focus() {
    if (!this.stack.focus) return;
    const [left, top, side] = this.stack.focus;
    const [width, height] = extent(this.stack);
    this.view = { x: left + side / 2 - 0.5, y: top + side / 2 - 0.5, zoom: Math.min(width, height) / side / 1.3 };
    this.draw();
  }

  zoomBy(factor, at = [this.view.x, this.view.y]) {
    const zoom = clamp(this.view.zoom * factor, 1, MOST_ZOOM);
    const share = 1 - this.view.zoom / zoom;
    this.view.x += (at[0] - this.view.x) * share;
    this.view.y += (at[1] - this.view.y) * share;
    this.view.zoom = zoom;
    this.pan(0, 0);
  }

  /** Move by px of the screen, never off the picture. */
  pan(right, down) {
    const [width, height] = extent(this.stack);
    const [across, along] = this.scale();
    const loose = this.view.zoom > 1 ? 0.5 : 0;
    this.view.x = clamp(this.view.x + right / across, (0.5 - loose) * width - 0.5, (0.5 + loose) * width - 0.5);
    this.view.y = clamp(this.view.y + down / along, (0.5 - loose) * height - 0.5, (0.5 + loose) * height - 0.5);
    this.draw();
  }

  get panels() {
    return this.mode === "side" ? 2 : 1;
  }

  /** Px of the screen in one of the picture, across and along. */
  scale() {
    const [width, height] = extent(this.stack);
    const across = (this.canvas.clientWidth / this.panels / width) * this.view.zoom;
    const along = (this.canvas.clientHeight / height) * this.view.zoom;
    return this.stack.circle ? [Math.min(across, along), Math.min(across, along)] : [across, along];
  }

  draw() {
    if (!this.window || this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = null;
      this.drawNow();
    });
  }

  drawNow() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const dense = window.devicePixelRatio || 1;
    // A finger scrolls the page up and down while there is nowhere to move the picture to.
    this.canvas.style.touchAction = this.view.zoom > 1 ? "none" : "pan-y";
    Object.assign(this.canvas, { width: width * dense, height: height * dense });
    const pen = this.canvas.getContext("2d");
    pen.scale(dense, dense);
    const [first, second] = this.pair;
    if (this.mode === "side") {
      this.put(pen, first, [0, width / 2]);
      this.put(pen, second, [width / 2, width / 2]);
      line(pen, width / 2, height);
    } else if (this.mode === "wipe") {
      const x = this.split * width;
      this.put(pen, first, [0, width], [0, x]);
      this.put(pen, second, [0, width], [x, width - x]);
      divider(pen, x, height);
    } else if (this.mode === "difference") {
      this.put(pen, "difference", [0, width]);
    } else {
      this.put(pen, this.swapped ? second : first, [0, width]);
    }
  }

  /** Draw a picture centred in `[left, width]` of the screen, seen through the same or another such gap. */
  put(pen, name, [left, width], gap = [left, width]) {
    const [across, along] = this.scale();
    const height = this.canvas.clientHeight;
    pen.save();
    pen.beginPath();
    pen.rect(gap[0], 0, gap[1], height);
    pen.clip();
    pen.translate(left + width / 2, height / 2);
    pen.scale(across, along);
    pen.translate(-this.view.x, -this.view.y);
    for (const part of this.parts.get(this.stack)) {
      pen.imageSmoothingEnabled = across * part.pixel[0] < 2;
      const size = [part.width * part.pixel[0], part.height * part.pixel[1]];
      pen.drawImage(part.canvas[name], part.origin[0] - 0.5, part.origin[1] - 0.5, ...size);
    }
    pen.restore();
  }

  /** Place in the picture under a place on the screen. */
  under([right, down]) {
    const box = this.canvas.getBoundingClientRect();
    const wide = box.width / this.panels;
    const x = (right - box.left) % wide;
    const [across, along] = this.scale();
    return [this.view.x + (x - wide / 2) / across, this.view.y + (down - box.top - box.height / 2) / along];
  }

  listen() {
    const { canvas } = this;
    followPointers(canvas, {
      grab: (event) => this.grab(event),
      drag: (event, moved) => this.drag(event, moved),
      pinch: (before, after) => this.pinch(before, after),
      release: () => { this.held = null; },
    });
    canvas.addEventListener("pointerleave", () => { this.said.textContent = ""; });
    canvas.addEventListener("wheel", (event) => this.roll(event), { passive: false });
    canvas.addEventListener("dblclick", () => this.fit());
    this.root.addEventListener("keydown", (event) => this.press(event));
  }

  grab(event) {
    if (!this.window) return;
    const x = event.clientX - this.canvas.getBoundingClientRect().left;
    const near = Math.abs(x - this.split * this.canvas.clientWidth) < GRIP;
    this.held = this.mode === "wipe" && (near || this.view.zoom === 1) ? "divider" : "picture";
    this.splitBefore = this.split;
    this.drag(event, [0, 0]);
  }

  drag(event, [right, down]) {
    if (!this.window) return;
    const box = this.canvas.getBoundingClientRect();
    if (this.held === "divider") this.wipe((event.clientX - box.left) / box.width);
    if (this.held === "picture") this.pan(-right, -down);
    this.read(...this.under([event.clientX, event.clientY]));
  }

  /** What lay between the fingers stays there; the first of them did not mean the divider. */
  pinch(before, after) {
    if (!this.window) return;
    if (this.held === "divider") this.wipe(this.splitBefore);
    this.held = "picture";
    this.zoomBy(after.apart / Math.max(before.apart, 1), this.under(before.middle));
    this.pan(before.middle[0] - after.middle[0], before.middle[1] - after.middle[1]);
  }

  /** Only where the picture has the focus: the wheel belongs to the page. */
  roll(event) {
    if (document.activeElement !== this.canvas && !event.ctrlKey) return;
    event.preventDefault();
    this.zoomBy(event.deltaY < 0 ? ZOOM_STEP : 1 / ZOOM_STEP, this.under([event.clientX, event.clientY]));
  }

  /** Say the values at a place. */
  read(x, y) {
    const values = this.names.map((name) => [this.spec.names[name], valueAt(this.parts.get(this.stack), name, x, y)]);
    if (values.some(([, value]) => value === null)) {
      this.said.textContent = "";
      return;
    }
    const [across, along] = this.spec.axes;
    const told = values.map(([name, value]) => `${name} ${number(value, 4)}`).join(" · ");
    this.said.textContent = `${across} ${Math.round(x)} · ${along} ${Math.round(y)}: ${told}`;
  }

  press(event) {
    if (!this.window || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.matches("input, select")) return;
    const step = event.shiftKey ? 0.1 : 0.02;
    const aside = (sign) => (this.view.zoom > 1 || this.mode !== "wipe" ? this.pan(40 * sign, 0) : this.wipe(this.split + sign * step));
    const onCanvas = event.target === this.canvas;
    const acts = {
      ...(onCanvas && {
        ArrowLeft: () => aside(-1),
        ArrowRight: () => aside(1),
        ArrowUp: () => this.pan(0, -40),
        ArrowDown: () => this.pan(0, 40),
      }),
      "+": () => this.zoomBy(ZOOM_STEP),
      "=": () => this.zoomBy(ZOOM_STEP),
      "-": () => this.zoomBy(1 / ZOOM_STEP),
      0: () => this.fit(),
      f: () => this.focus(),
      n: () => this.picker.choose((this.at + 1) % this.spec.stacks.length),
      ...(this.compares && {
        "[": () => this.wipe(this.split - step),
        "]": () => this.wipe(this.split + step),
        b: () => this.blinkByHand(),
        w: () => this.enter("wipe"),
        s: () => this.enter("side"),
        d: () => this.enter("difference"),
      }),
    };
    const act = acts[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  blinkByHand() {
    if (this.mode !== "blink") this.enter("blink");
    clearInterval(this.timer);
    this.swap();
  }
}

/** Only the keys that do something here. */
function keyList(there) {
  const rows = Object.entries(KEYS).filter(([name]) => there[name] ?? true).map(([, [keys, meaning]]) =>
    element("div", {}, element("kbd", {}, keys), ` ${meaning}`));
  return element("details", { class: "keys" }, element("summary", {}, "keys"), ...rows,
    element("div", {}, "The wheel zooms once the picture has been clicked; two fingers zoom at once."));
}
