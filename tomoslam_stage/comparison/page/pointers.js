/** Mouse and fingers on a picture: one of them drags, two pinch. */

/**
 * `grab(event)` is told when the first pointer goes down, `drag(event, [right, down])` how far it moved,
 * also when none is down, and `pinch(before, after)` where the middle of two was and is, and how far apart.
 */
function followPointers(canvas, { grab, drag, pinch, release }) {
  const held = new Map();
  const place = (event) => [event.clientX, event.clientY];

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, place(event));
    if (held.size === 1) grab(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = [...held.values()];
    const [x, y] = held.get(event.pointerId) ?? place(event);
    if (held.has(event.pointerId)) held.set(event.pointerId, place(event));
    if (held.size < 2) drag(event, [event.clientX - x, event.clientY - y]);
    else pinch(between(before), between([...held.values()]));
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => {
      held.delete(event.pointerId);
      if (!held.size) release();
    });
  }
  // The page must not scroll away under two fingers.
  canvas.addEventListener("touchmove", (event) => { if (event.touches.length > 1) event.preventDefault(); }, { passive: false });
}

/** Middle of the first two places, and the distance between them. */
function between([[left, top], [right, bottom]]) {
  return { middle: [(left + right) / 2, (top + bottom) / 2], apart: Math.hypot(right - left, bottom - top) };
}
