/** What the viewers draw: greys and differences of pictures, in parts. */

/** Stacks of one size keep the view when the reader goes from one to the other. */
function sameSize(first, second) {
  return first.width === second.width && first.height === second.height;
}

/** Width and height of a stack in px of the reconstruction. */
function extent(stack) {
  return [stack.width * stack.pixel[0], stack.height * stack.pixel[1]];
}

/** The whole picture and, where that was shrunk, its most changed part in full. */
async function unpacked(stack) {
  const parts = [];
  for (const part of [stack, stack.detail].filter(Boolean)) {
    const layers = await Promise.all(Object.values(part.layers).map(greys));
    const named = Object.fromEntries(Object.keys(part.layers).map((name, k) => [name, layers[k]]));
    parts.push({ ...part, greys: named, canvas: {}, seen: seenIn(part, stack.circle) });
  }
  return parts;
}

/** Where every projection looked: 1, else 0. */
function seenIn(part, circle) {
  const seen = new Uint8Array(part.width * part.height).fill(1);
  if (!circle) return seen;
  const [x, y, radius] = circle;
  for (let k = 0; k < seen.length; k += 1) {
    const column = part.origin[0] + ((k % part.width) + 0.5) * part.pixel[0] - 0.5;
    const row = part.origin[1] + (Math.floor(k / part.width) + 0.5) * part.pixel[1] - 0.5;
    seen[k] = Number(Math.hypot(column - x, row - y) <= radius);
  }
  return seen;
}

/** Grey on the screen of each stored grey. */
function greyTable([low, high], [least, most]) {
  const table = new Uint8ClampedArray(65536);
  for (let k = 0; k < 65536; k += 1) {
    const value = least + (k / 65535) * (most - least);
    table[k] = (255 * (value - low)) / (high - low);
  }
  return table;
}

function painted(part, values, table) {
  return filled(part, (pixels, k) => {
    pixels[4 * k] = pixels[4 * k + 1] = pixels[4 * k + 2] = table[values[k]];
  });
}

const MORE = [178, 24, 43];
const LESS = [33, 102, 172];

/** Second minus first: red is more, blue is less, white is the same. */
function difference(part, [first, second], most) {
  const a = part.greys[first];
  const b = part.greys[second];
  const unit = (part.limits[1] - part.limits[0]) / 65535 / most;
  return filled(part, (pixels, k) => {
    const share = clamp((b[k] - a[k]) * unit, -1, 1);
    const colour = share > 0 ? MORE : LESS;
    for (let c = 0; c < 3; c += 1) pixels[4 * k + c] = 255 + (colour[c] - 255) * Math.abs(share);
  });
}

function filled(part, fill) {
  const canvas = element("canvas", { width: part.width, height: part.height });
  const pen = canvas.getContext("2d");
  const image = pen.createImageData(part.width, part.height);
  for (let k = 0; k < part.seen.length; k += 1) {
    fill(image.data, k);
    image.data[4 * k + 3] = 255 * part.seen[k];
  }
  pen.putImageData(image, 0, 0);
  return canvas;
}

/** Value at a place, from the finest part that has it; null outside. */
function valueAt(parts, name, x, y) {
  for (const part of [...parts].reverse()) {
    const column = Math.floor((x + 0.5 - part.origin[0]) / part.pixel[0]);
    const row = Math.floor((y + 0.5 - part.origin[1]) / part.pixel[1]);
    const inside = column >= 0 && row >= 0 && column < part.width && row < part.height;
    const k = row * part.width + column;
    if (inside && part.seen[k]) {
      return part.limits[0] + (part.greys[name][k] / 65535) * (part.limits[1] - part.limits[0]);
    }
  }
  return null;
}

/** The line between two pictures. */
function line(pen, x, height) {
  pen.fillStyle = "#e69f00";
  pen.fillRect(x - 1, 0, 2, height);
}

/** The same with a grip. */
function divider(pen, x, height) {
  line(pen, x, height);
  pen.beginPath();
  pen.arc(x, height / 2, 13, 0, 2 * Math.PI);
  pen.fill();
  pen.fillStyle = "#1c1c1e";
  pen.font = "bold 13px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillText("↔", x, height / 2 + 1);
}
