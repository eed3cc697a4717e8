// What is under the pointer, and its numbers.

function number(value, digits = 4) {
  if (!Number.isFinite(value)) return "—";
  const text = Number(value.toPrecision(digits));
  const size = Math.abs(text);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) {
    const [mantissa, exponent] = text.toExponential().split("e");
    const raised = [...exponent.replace("+", "")].map((c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c] ?? "⁻").join("");
    return `${mantissa.replace("-", "−")}·10${raised}`;
  }
  return String(text).replace("-", "−");
}

// The particle or spring nearest to a point of the picture (pixels from its middle, y upwards), if one is within reach.
function pick(data, frame, view, [x, y], reach) {
  const { matrix, shift } = view;
  const { particles, springs } = about;
  const { places, pairs } = data;
  const seen = new Float32Array(3 * particles);
  let best = null;
  const offer = (kind, index, distance, height) => {
    if (distance > reach) return;
    // A particle is smaller than a spring and easily missed; what is nearer to the eye covers what is behind it.
    const score = distance - (kind === "particle" ? 0.4 * reach : 0) - (0.5 * reach * height) / view.depth;
    if (!best || score < best.score) best = { kind, index, score };
  };
  for (let i = 0, at = frame * 3 * particles; i < particles; i++, at += 3) {
    const [a, b, c] = [places[at], places[at + 1], places[at + 2]];
    for (let k = 0; k < 3; k++) seen[3 * i + k] = matrix[k][0] * a + matrix[k][1] * b + matrix[k][2] * c + shift[k];
    offer("particle", i, Math.hypot(seen[3 * i] - x, seen[3 * i + 1] - y) * 1.6, seen[3 * i + 2]);
  }
  for (let s = 0; s < springs; s++) {
    const [i, j] = [3 * pairs[2 * s], 3 * pairs[2 * s + 1]];
    const [ax, ay, bx, by] = [seen[i], seen[i + 1], seen[j], seen[j + 1]];
    const length = (bx - ax) ** 2 + (by - ay) ** 2;
    const part = length > 0 ? Math.min(1, Math.max(0, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length)) : 0;
    const distance = Math.hypot(ax + part * (bx - ax) - x, ay + part * (by - ay) - y);
    if (distance <= reach) offer("spring", s, distance, seen[i + 2] + part * (seen[j + 2] - seen[i + 2]));
  }
  return best && { [best.kind]: best.index };
}

// Where a particle is, in pixels of the window.
function locate(canvas, data, frame, { matrix, shift }, i) {
  const { left, top, width, height } = canvas.getBoundingClientRect();
  const q = data.places.subarray(3 * (frame * about.particles + i));
  const [x, y] = [0, 1].map((k) => matrix[k].reduce((sum, value, axis) => sum + value * q[axis], shift[k]));
  return [left + width / 2 + x, top + height / 2 - y];
}

const KINDS = ["", "held", "moved"];

// A few lines about what was picked, the first its name.
function describe(data, frame, chosen) {
  if (chosen.particle !== undefined) {
    const i = chosen.particle;
    const name = `particle ${data.particleNumber.at(i)}`;
    const kind = KINDS[data.kinds[i]];
    const x = data.place(frame, i);
    const start = data.place(0, i);
    const axes = x.slice(0, about.dimension).map((value, axis) => `${"xyz"[axis]} = ${number(value, 5)} m`);
    const moved = Math.hypot(...x.map((value, axis) => value - start[axis]));
    return [kind ? `${name}, ${kind}` : name, axes.join(", "), `${number(moved, 3)} m from where it started`];
  }
  const s = chosen.spring;
  const [i, j] = [data.pairs[2 * s], data.pairs[2 * s + 1]].map((p) => data.particleNumber.at(p));
  const strain = data.strain(frame, s);
  const percent = `${strain > 0 ? "+" : ""}${number(100 * strain, 3)} %`;
  const state = strain < 0 ? "compressed" : strain > 0 ? "stretched" : "at rest";
  if (about.merged) return [`springs from ${i} to ${j}`, `${state} on average: strain ${percent}`];
  const rest = data.rest[s];
  const force = data.stiffness[s] * strain;
  return [
    `spring ${data.springNumber.at(s)}, from ${i} to ${j}`,
    `${state}: strain ${percent}`,
    `length ${number(rest * (1 + strain))} m, at rest ${number(rest)} m`,
    `force ${number(force, 3)} N${force < 0 ? " (it pushes)" : ""}`,
  ];
}
