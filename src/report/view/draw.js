// A frame of the scene on the canvas.

// Springs beyond which thin lines are not blended.
const MANY = 20000;
// Steps of paleness from near to far.
const SHADES = 16;

// How wide springs and particles are, in pixels: as wide as they are far apart, within what reads well.
function looks(scale) {
  const spacing = about.spacing * scale;
  // A place alone is far from all others.
  const dot = spacing > 0 ? Math.min(9, spacing / 5) : 9;
  return {
    line: Math.min(5, Math.max(1.25, spacing / 14)),
    dot: dot < 2.5 ? 0 : dot,
    mark: Math.max(about.marks > 200 ? 4 : 8, Math.min(13, dot + 4)),
  };
}

function painter(canvas, data) {
  const { particles, springs } = about;
  const raster = rasteriser(canvas);
  const seen = new Float32Array(3 * particles);
  const shades = new Uint32Array(256 * SHADES);
  let inked = null;

  // Colours of all strains at all distances.
  function mix(style) {
    if (inked === style.map) return;
    inked = style.map;
    for (let at = 0; at < 256; at++) {
      const below = Math.min(7, Math.floor((at * 8) / 255));
      const part = (at * 8) / 255 - below;
      for (let far = 0; far < SHADES; far++) {
        const pale = 0.55 * (far / (SHADES - 1)) ** 2;
        const colour = [0, 1, 2].map((k) => {
          const pure = style.map[3 * below + k] * (1 - part) + style.map[3 * below + 3 + k] * part;
          return pure * (1 - pale) + style.paper[k] * pale;
        });
        shades[at * SHADES + far] = packed(colour);
      }
    }
  }

  // All particles from where the camera stands; rows of pixels go down, and a pixel reaches half a unit around its number.
  function project(frame, view, ratio) {
    const [right, up, near] = view.matrix.map((row) => row.map((value) => value * ratio));
    const shift = view.shift.map((value) => value * ratio);
    const { places } = data;
    for (let i = 0, at = frame * 3 * particles; i < 3 * particles; i += 3, at += 3) {
      const a = places[at], b = places[at + 1], c = places[at + 2];
      seen[i] = canvas.width / 2 + right[0] * a + right[1] * b + right[2] * c + shift[0] - 0.5;
      seen[i + 1] = canvas.height / 2 - (up[0] * a + up[1] * b + up[2] * c + shift[1]) - 0.5;
      seen[i + 2] = near[0] * a + near[1] * b + near[2] * c + shift[2];
    }
  }

  function drawSprings(frame, lineWidth, depth, style, chosen) {
    const { strains, pairs } = data;
    const { levels, largest, shown } = about.strain;
    const steepness = largest / shown / (levels * levels);
    const fast = springs > MANY && lineWidth < 2 * style.ratio;
    for (let s = 0, at = frame * springs; s < springs; s++, at++) {
      const i = pairs[2 * s], j = pairs[2 * s + 1];
      const q = strains[at];
      const tone = Math.round(127.5 + 127.5 * Math.max(-1, Math.min(1, q * Math.abs(q) * steepness)));
      const far = 0.5 - (0.25 * (seen[3 * i + 2] + seen[3 * j + 2])) / depth;
      const shade = shades[tone * SHADES + Math.round((SHADES - 1) * Math.max(0, Math.min(1, far)))];
      if (s === chosen) raster.line(seen, i, j, lineWidth + 4 * style.ratio, shade, 0.02 * depth);
      else if (fast) raster.thin(seen, i, j, shade);
      else raster.line(seen, i, j, lineWidth, shade, 0);
    }
  }

  // Free particles are discs, held ones squares, moved ones diamonds.
  function drawParticles(sizes, depth, style, chosen) {
    const inks = [0, 1, 2].map((kind) => packed(style.inks.slice(3 * kind, 3 * kind + 3)));
    const dot = style.particles ? sizes.dot : 0;
    for (let i = 0; i < particles; i++) {
      const kind = data.kinds[i];
      const size = style.ratio * ((kind === 0 ? dot : sizes.mark) + (i === chosen ? 7 : 0));
      if (size >= 1) raster.mark(seen, i, kind, size, inks[kind], 0.004 * depth);
    }
  }

  return function draw(frame, view, style, chosen) {
    const depth = view.depth * style.ratio;
    const sizes = looks(view.scale);
    mix(style);
    raster.clear(style.paper);
    project(frame, view, style.ratio);
    if (style.surface) {
      const { triangles } = data;
      for (let k = 0; k < triangles.length; k += 3) {
        raster.triangle(seen, triangles[k], triangles[k + 1], triangles[k + 2], style.face, 0.004 * depth);
      }
    }
    if (style.springs) drawSprings(frame, sizes.line * style.ratio, depth, style, chosen.spring);
    drawParticles(sizes, depth, style, chosen.particle);
    raster.show();
  };
}
