// Mouse, pen and fingers on the picture.

// One pointer turns, with Shift or another button it moves; two magnify and move; a wheel magnifies around the pointer. `choose`
// is called with a point, how far it reaches in pixels, and whether what is found shall stay.
function gestures(canvas, look, choose) {
  const pointers = new Map();
  let travelled = 0;
  const point = (event) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    return [event.clientX - left - width / 2, height / 2 - (event.clientY - top)];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, point(event));
    travelled = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const now = point(event);
    const before = pointers.get(event.pointerId);
    if (!before) return choose(now, 10, false);
    const step = [now[0] - before[0], before[1] - now[1]];
    travelled += Math.hypot(...step);
    if (pointers.size === 1) {
      if (event.shiftKey || event.buttons > 1) shiftView(...step);
      else orbit(...step);
    } else {
      const [other] = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const apart = (at) => Math.hypot(at[0] - other[0], at[1] - other[1]);
      magnify(apart(now) / Math.max(1, apart(before)), [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]);
      shiftView(step[0] / 2, step[1] / 2);
    }
    pointers.set(event.pointerId, now);
    look();
  });
  const release = (event) => {
    const tapped = event.type === "pointerup" && pointers.size === 1 && travelled < 6;
    pointers.delete(event.pointerId);
    if (tapped) choose(point(event), event.pointerType === "mouse" ? 10 : 22, true);
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", (event) => pointers.size || choose([Infinity, Infinity], 0, false));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    magnify(Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)), point(event));
    look();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => {
    resetCamera();
    look();
  });
}

// A length that can be compared: one, two or five times a power of ten, about 90 pixels long.
function scaleBar(scale) {
  const power = 10 ** Math.floor(Math.log10(90 / scale));
  const length = [5, 2, 1].map((k) => k * power).find((one) => one * scale <= 110) ?? power;
  // As a share of the picture, which paper may show smaller.
  document.getElementById("bar").style.width = `${(100 * length * scale) / camera.width}cqw`;
  document.getElementById("length").textContent = `${number(length)} m`;
}

// The directions of the axes.
function compass(rows) {
  const holder = document.getElementById("compass");
  holder.replaceChildren();
  for (let axis = 0; axis < Math.max(about.dimension, about.dimension < 3 ? 1 : 3); axis++) {
    const [x, y] = [24 * rows[0][axis], -24 * rows[1][axis]];
    element("svg:line", { x1: 0, y1: 0, x2: x, y2: y }, holder);
    if (Math.hypot(x, y) > 6) element("svg:text", { x: 1.38 * x, y: 1.38 * y }, holder).textContent = "xyz"[axis];
  }
}
