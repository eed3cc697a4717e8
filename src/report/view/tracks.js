// Curves over time below the picture, with a mark at the frame that is shown.

const SHAPE = "http://www.w3.org/2000/svg";

function element(kind, attributes, parent) {
  const made = kind.startsWith("svg:") ? document.createElementNS(SHAPE, kind.slice(4)) : document.createElement(kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  parent?.append(made);
  return made;
}

// The last entry of ascending times that is not later.
function lastBefore(times, time) {
  let [low, high] = [0, times.length - 1];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}

// One panel: { title, unit, times, curves: [{ name, values }] }. `seek` is told the time that was pointed at.
function track(parent, { title, unit, times, curves }, seek) {
  const panel = element("figure", { class: "track" }, parent);
  const caption = element("figcaption", {}, panel);
  element("strong", {}, caption).textContent = unit ? `${title}, ${unit}` : title;
  const values = curves.map(({ name }, k) => {
    const entry = element("span", { class: `value series${k}` }, caption);
    if (curves.length > 1) entry.append(`${name} `);
    return element("output", {}, entry);
  });
  const all = curves.flatMap((curve) => curve.values).filter(Number.isFinite);
  let [low, high] = [Math.min(0, ...bounds(all)), Math.max(0, ...bounds(all))];
  if (!(high > low)) [low, high] = [low - 0.5, high + 0.5];
  const [start, end] = [times[0], times[times.length - 1]];
  const x = (time) => (end > start ? (1000 * (time - start)) / (end - start) : 500);
  const y = (value) => 96 - (92 * (value - low)) / (high - low);
  const plot = element("div", { class: "plot" }, panel);
  const label = `${title}: from ${number(low)} to ${number(high)} ${unit}`;
  const svg = element("svg:svg", { viewBox: "0 0 1000 100", preserveAspectRatio: "none", role: "img", "aria-label": label }, plot);
  element("svg:line", { class: "zero", x1: 0, x2: 1000, y1: y(0), y2: y(0) }, svg);
  curves.forEach((curve, k) => {
    let path = "";
    let pen = "M";
    curve.values.forEach((value, i) => {
      if (!Number.isFinite(value)) return (pen = "M");
      path += `${pen}${x(times[i]).toFixed(1)} ${y(value).toFixed(2)}`;
      pen = "L";
    });
    element("svg:path", { class: `series${k}`, d: path }, svg);
  });
  const mark = element("svg:line", { class: "now", y1: 0, y2: 100, x1: 0, x2: 0 }, svg);
  // Counts are whole numbers, and stay so.
  const digits = all.every(Number.isInteger) ? 15 : 3;
  element("span", { class: "high" }, plot).textContent = number(high, digits);
  element("span", { class: "low" }, plot).textContent = number(low, digits);
  const point = (event) => {
    const { left, width } = svg.getBoundingClientRect();
    seek(start + Math.min(1, Math.max(0, (event.clientX - left) / width)) * (end - start));
  };
  svg.addEventListener("pointerdown", (event) => {
    svg.setPointerCapture(event.pointerId);
    point(event);
  });
  svg.addEventListener("pointermove", (event) => event.buttons && point(event));
  return (time) => {
    const at = lastBefore(times, time);
    for (const end of ["x1", "x2"]) mark.setAttribute(end, x(time));
    values.forEach((output, k) => (output.textContent = number(curves[k].values[at], Math.max(4, digits))));
  };
}

// Smallest and largest, without a call of a million arguments.
function bounds(values) {
  return values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
}
