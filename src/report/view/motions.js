// The page of motions about a state: the one that is chosen swings, x = x₀ + s sin θ (xₖ − x₀).

// Seconds in which a motion swings once.
const SWING = 2;

async function start() {
  const began = performance.now();
  const { particles, springs, frames, amplitude } = about;
  const kept = await load();
  // The first frame is the state, each other one the state moved by a motion. Shown is the second frame of two: the state, and it swinging.
  const data = { ...kept, places: new Float32Array(6 * particles), strains: new Float32Array(2 * springs) };
  data.places.set(kept.places.subarray(0, 3 * particles));
  data.strains.set(kept.strains.subarray(0, springs));
  let motion = 1;
  let size = 1; // the amplitude over the one of the frames that are kept
  let angle = Math.PI / 2;
  let before = null; // while it plays: the moment of the last refresh
  let stale = true;

  // Room for both ends of every motion.
  const most = Math.ceil((particles * frames) / 20000);
  for (let frame = 0; frame < frames; frame++) {
    for (let i = 0; i < particles; i += frame === 0 ? 1 : most) {
      const [x, end] = [kept.place(0, i), kept.place(frame, i)];
      visited.push(end, x.map((value, axis) => 2 * value - end[axis]));
    }
  }

  function compose() {
    const s = size * Math.sin(angle);
    const { places, strains, pairs } = data;
    const moved = 3 * particles * motion;
    for (let at = 0; at < 3 * particles; at++) places[3 * particles + at] = places[at] + s * (kept.places[moved + at] - places[at]);
    const length = (frame, i, j) => {
      const [a, b] = [3 * (frame * particles + i), 3 * (frame * particles + j)];
      return Math.hypot(places[a] - places[b], places[a + 1] - places[b + 1], places[a + 2] - places[b + 2]);
    };
    // Strains of the state are kept better than its places: 1 + s = (1 + s₀) l/l₀ with the length l₀ in the state.
    const { levels, largest } = about.strain;
    for (let k = 0; k < springs; k++) {
      const [i, j] = [pairs[2 * k], pairs[2 * k + 1]];
      const start = length(0, i, j);
      const strain = start > 0 ? ((1 + data.strain(0, k)) * length(1, i, j)) / start - 1 : 0;
      strains[springs + k] = levels * Math.sign(strain) * Math.sqrt(Math.abs(strain) / largest);
    }
    picture.changed();
  }

  const picture = stage(data, () => 1);

  function choose(next) {
    motion = next;
    stale = true;
    const row = document.querySelector(`input[name=motion][value="${next}"]`);
    row.checked = true;
    $("time").textContent = row.closest("tr").dataset.name;
    $("count").textContent = row.closest("tr").dataset.about;
  }

  function play(on) {
    before = on ? performance.now() : null;
    $("play").textContent = on ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  }

  function enlarge() {
    size = Number($("slider").value) / 100 / amplitude.part;
    const told = `${number(size * amplitude.length, 3)} m`;
    $("slider").setAttribute("aria-valuetext", told);
    $("size").textContent = told;
    stale = true;
  }

  function advance(moment) {
    if (before !== null) {
      angle += (2 * Math.PI * Math.max(0, moment - before)) / 1000 / SWING;
      before = moment;
      stale = true;
    }
    if (stale) compose();
    stale = false;
    picture.draw();
    requestAnimationFrame(advance);
  }

  $("play").addEventListener("click", () => play(before === null));
  $("slider").addEventListener("input", enlarge);
  $("motions").addEventListener("change", (event) => choose(Number(event.target.value)));
  for (const row of $("motions").querySelectorAll("tr[data-name]")) {
    row.addEventListener("click", () => choose(Number(row.querySelector("input").value)));
  }
  const step = (by) => choose(1 + ((motion - 1 + by + frames - 1) % (frames - 1)));
  picture.watch({ " ": () => play(before === null), n: () => step(1), p: () => step(-1) });

  enlarge();
  choose(Number(document.querySelector("input[name=motion]:checked").value));
  compose();
  // For scripts: the state of the page, and where a particle is in the window.
  globalThis.viewer = {
    choose,
    turn: (to) => ((angle = to), (stale = true)),
    where: (i) => locate(canvas, data, 1, projection(), i),
    get motion() { return motion; },
    get angle() { return angle; },
    get draws() { return picture.draws; },
    get playing() { return before !== null; },
    loaded: performance.now() - began,
  };
  if (!still()) play(true);
  requestAnimationFrame(advance);
  document.documentElement.dataset.ready = "";
}
