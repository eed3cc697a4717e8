// From the text of the page to arrays.

const about = JSON.parse(document.getElementById("about").textContent);

// The bytes of an element's base64 text, inflated piece by piece.
async function inflate(id) {
  const text = document.getElementById(id).textContent;
  const piece = 1 << 20;
  let at = 0;
  const packed = new ReadableStream({
    pull(queue) {
      if (at >= text.length) return queue.close();
      const letters = atob(text.slice(at, at + piece));
      const bytes = new Uint8Array(letters.length);
      for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
      queue.enqueue(bytes);
      at += piece;
    },
  });
  const stream = packed.pipeThrough(new DecompressionStream("deflate-raw"));
  return new Response(stream).arrayBuffer();
}

// Undoes the prediction along time. A channel has `count` values in each of `frames` frames; the first is kept as it is, the
// others as the remainder of a prediction from the one frame before (order 1) or the two before (order 2), folded so that
// small remainders of both signs are small numbers; two bytes are kept as a plane of low and a plane of high ones.
// The value of item i goes to target[(frame * count + i) * spread + start].
function restore(bytes, channel, frames, count, target, spread, start) {
  const { offset, order, wide } = channel;
  const stride = count * spread;
  const plane = frames * count;
  for (let frame = 0, source = offset; frame < frames; frame++) {
    const use = Math.min(frame, order);
    for (let i = 0, to = frame * stride + start; i < count; i++, source++, to += spread) {
      const folded = wide ? bytes[source] | (bytes[source + plane] << 8) : bytes[source];
      const rest = (folded >> 1) ^ -(folded & 1);
      const guess =
        use === 2 ? 2 * target[to - stride] - target[to - 2 * stride] : use === 1 ? target[to - stride] : 0;
      target[to] = guess + rest;
    }
  }
}

async function load() {
  const buffer = await inflate("data");
  const bytes = new Uint8Array(buffer);
  const { particles, springs, frames, sections, channels } = about;
  const part = (Kind, name) => {
    const [offset, length] = sections[name];
    return new Kind(buffer, offset, length / Kind.BYTES_PER_ELEMENT);
  };
  const places = new Uint16Array(frames * 3 * particles);
  for (let axis = 0; axis < 3; axis++) restore(bytes, channels.places[axis], frames, particles, places, 3, axis);
  const Strain = channels.strain.wide ? Int16Array : Int8Array;
  const strains = new Strain(frames * springs);
  restore(bytes, channels.strain, frames, springs, strains, 1, 0);
  const numbers = (name, count) => (sections[name] ? part(Uint32Array, name) : { at: (i) => i, length: count });
  return {
    places,
    strains,
    pairs: part(Uint32Array, "pairs"),
    rest: part(Float32Array, "rest"),
    stiffness: part(Float32Array, "stiffness"),
    kinds: part(Uint8Array, "kinds"),
    triangles: part(Uint32Array, "triangles"),
    particleNumber: numbers("particle_numbers", particles),
    springNumber: numbers("spring_numbers", springs),
    // x of particle i in a frame, in m.
    place(frame, i) {
      const at = 3 * (frame * particles + i);
      return about.origin.map((low, axis) => low + about.quantum * this.places[at + axis]);
    },
    strain(frame, s) {
      const q = this.strains[frame * springs + s] / about.strain.levels;
      return about.strain.largest * q * Math.abs(q);
    },
  };
}
