// Where the scene is looked at from: a turntable without perspective, so that lengths can be compared.

const camera = { yaw: 0, pitch: 0, zoom: 1, pan: [0, 0], width: 1, height: 1, fit: 1, centre: [0, 0] };
const flat = about.dimension < 3 || about.depthless;

function resetCamera() {
  Object.assign(camera, { yaw: flat ? 0 : (35 * Math.PI) / 180, pitch: flat ? 0 : (22 * Math.PI) / 180, zoom: 1, pan: [0, 0] });
  fitCamera();
}

// Rows: right, up and towards the eye, in the scene's axes.
function turn() {
  const [sy, cy, sp, cp] = [Math.sin(camera.yaw), Math.cos(camera.yaw), Math.sin(camera.pitch), Math.cos(camera.pitch)];
  const rows = [
    [cy, 0, -sy],
    [-sy * sp, cp, -cy * sp],
    [sy * cp, sp, cy * cp],
  ];
  // The scene's upward axis takes the place of y; the two others follow in order, so that hands stay right.
  const { axis, sign } = about.up;
  return rows.map((row) => {
    const turned = [0, 0, 0];
    for (let k = 0; k < 3; k++) turned[(axis + 2 + k) % 3] = row[k];
    return sign < 0 ? [turned[0], turned[1], turned[2]].map((v, k) => (k === (axis + 1) % 3 ? v : -v)) : turned;
  });
}

// Some thousand places where particles come by, to know how much room the motion takes.
const visited = [];

function visit(data) {
  const { frames, particles } = about;
  for (let k = 0; k < Math.min(frames, 40); k++) {
    const frame = Math.floor((k * (frames - 1)) / Math.max(1, Math.min(frames, 40) - 1));
    const every = frame === 0 || frame === frames - 1 ? 1 : Math.ceil(particles / 400);
    for (let i = 0; i < particles; i += every) visited.push(data.place(frame, i));
  }
  for (const end of ["low", "high"]) if (!visited.length) visited.push(about.bounds[end]);
}

// The scale at which the whole motion is seen from where the camera stands, and what is in the middle then.
function fitCamera() {
  const rows = turn();
  const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
  for (const x of visited) {
    for (let k = 0; k < 2; k++) {
      const value = rows[k][0] * x[0] + rows[k][1] * x[1] + rows[k][2] * x[2];
      low[k] = Math.min(low[k], value);
      high[k] = Math.max(high[k], value);
    }
  }
  const [wide, tall] = [0, 1].map((k) => high[k] - low[k]);
  // Room for the legend and the scale bar, where the picture is wide enough for it.
  const [beside, above] = [camera.width > 700 ? 40 : 24, camera.width > 700 ? 40 : 92];
  camera.fit = Math.min((camera.width - 2 * beside) / wide, (camera.height - 2 * above) / tall);
  // Of a single place every scale shows everything.
  if (!(camera.fit > 0 && camera.fit < Infinity)) camera.fit = 1;
  camera.centre = [0, 1].map((k) => (low[k] + high[k]) / 2);
}

// From quanta to pixels from the middle of the picture: p = matrix·q + shift, and half the depth of what can be seen.
function projection() {
  const rows = turn();
  const scale = camera.fit * camera.zoom;
  const middle = about.bounds.low.map((low, axis) => (low + about.bounds.high[axis]) / 2);
  const matrix = rows.map((row) => row.map((value) => value * scale * about.quantum));
  const offset = about.origin.map((low, axis) => low - middle[axis]);
  const shift = rows.map((row) => scale * (row[0] * offset[0] + row[1] * offset[1] + row[2] * offset[2]));
  // The middle of what is seen when everything is, from the middle of the box.
  const seen = [0, 1].map((k) => camera.centre[k] - middle.reduce((sum, value, axis) => sum + rows[k][axis] * value, 0));
  shift[0] += camera.pan[0] - scale * seen[0];
  shift[1] += camera.pan[1] - scale * seen[1];
  const diagonal = Math.hypot(...about.bounds.low.map((low, axis) => about.bounds.high[axis] - low));
  return { matrix, shift, depth: Math.max(1, (scale * diagonal) / 2), scale, rows };
}

// Turns, moves and magnifies; `at` is a point of the picture that stays where it is, in pixels from its middle, y upwards.
function orbit(right, down) {
  if (flat && about.dimension < 3) return shiftView(right, down);
  camera.yaw -= right * 0.008;
  camera.pitch = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, camera.pitch + down * 0.008));
}

function shiftView(right, down) {
  camera.pan = [camera.pan[0] + right, camera.pan[1] - down];
}

function magnify(factor, at = [0, 0]) {
  const zoom = Math.min(1e4, Math.max(0.05, camera.zoom * factor));
  const ratio = zoom / camera.zoom;
  camera.zoom = zoom;
  camera.pan = camera.pan.map((pan, k) => at[k] + (pan - at[k]) * ratio);
}
