/** What all parts of the page need: elements, numbers, and arrays out of text. */

const page = JSON.parse(document.getElementById("data").textContent);

/** Make an element; attributes that begin with "on" are listeners, those that are null are left out. */
function element(tag, attributes = {}, ...children) {
  return furnished(document.createElement(tag), attributes, children);
}

/** The same for a part of a drawing. */
function drawn(tag, attributes = {}, ...children) {
  return furnished(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

function furnished(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== null && value !== false) made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

/** A number as people write it. */
function number(value, digits = 4) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const size = Math.abs(value);
  const far = size !== 0 && (size < 1e-4 || size >= 1e6);
  const text = far ? value.toExponential(digits - 2) : String(Number(value.toPrecision(digits)));
  return text.replace("-", "−").replace("e−", "e-");
}

function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

/** Bytes that were deflated and written as text. */
async function inflated(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

/** Greys of a picture, 0 to 65535: all low bytes come before all high ones. */
async function greys(text) {
  const bytes = new Uint8Array(await inflated(text));
  const size = bytes.length / 2;
  const values = new Uint16Array(size);
  for (let k = 0; k < size; k += 1) values[k] = bytes[k] | (bytes[k + size] << 8);
  return values;
}

/** A row of buttons of which one is pressed. */
function choice(title, options, chosen, onchoose) {
  const buttons = Object.entries(options).map(([key, label]) =>
    element("button", { type: "button", "data-key": key, onclick: () => onchoose(key) }, label),
  );
  const group = element("fieldset", {}, element("legend", {}, title), element("div", { class: "pairs" }, ...buttons));
  group.press = (key) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.key === key));
  };
  group.press(chosen);
  return group;
}

/** A list of which one is chosen. */
function list(title, labels, chosen, onchoose) {
  const options = labels.map((label, k) => element("option", { value: k, selected: k === chosen }, label));
  const select = element("select", { "aria-label": title, onchange: () => onchoose(Number(select.value)) }, ...options);
  const group = element("div", {}, element("label", { class: "title" }, title), select);
  group.choose = (k) => {
    select.value = k;
    onchoose(k);
  };
  return group;
}

/** A slider with its title; what it says is set with `tell`. */
function slider(title, attributes, oninput) {
  const said = element("span");
  const input = element("input", { type: "range", step: "any", "aria-label": title, ...attributes,
    oninput: () => oninput(Number(input.value)) });
  const group = element("div", {}, element("div", { class: "row apart" }, element("span", {}, title), said), input);
  group.input = input;
  group.tell = (value, words) => {
    input.value = value;
    said.textContent = words;
    input.setAttribute("aria-valuetext", words);
  };
  return group;
}
