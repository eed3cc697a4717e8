// The page: buttons, slider, keys, fingers; and what is drawn when.

const $ = (id) => document.getElementById(id);
const canvas = $("picture");

function say(text) {
  $("message").textContent = text;
  $("message").hidden = !text;
}

// Colours from the style sheet, so that they are said once and follow light and dark.
function readStyle() {
  const css = getComputedStyle(document.documentElement);
  const colour = (name) => css.getPropertyValue(name).trim().match(/[0-9a-f]{2}/gi).map((pair) => parseInt(pair, 16) / 255);
  return {
    paper: colour("--stage"),
    face: colour("--face"),
    map: Array.from({ length: 9 }, (_, k) => colour(`--map${k}`)).flat(),
    inks: ["--dot", "--held", "--moved"].flatMap(colour),
    ratio: 1,
    ...switches,
  };
}

const switches = { springs: true, particles: true, surface: true };

async function start() {
  const began = performance.now();
  const data = await load();
  const paint = painter(canvas, data);
  const { times } = about;
  const last = times.length - 1;
  let style = readStyle();
  let frame = 0;
  let chosen = {};
  let pinned = false;
  let stale = true;
  let draws = 0;
  let clock = null; // while it plays: the moment and the time of the motion at which it began
  let speed = about.speed;

  const panels = [];
  const seek = (time) => show(lastBefore(times, time), true);
  about.tracks.forEach((one) => panels.push(track($("tracks"), one, seek)));

  function show(next, byHand) {
    frame = Math.min(last, Math.max(0, next));
    if (byHand && clock) clock = { moment: performance.now(), time: times[frame] };
    const time = times[frame];
    $("slider").value = frame;
    $("slider").setAttribute("aria-valuetext", `t = ${number(time)} s`);
    $("time").textContent = `t = ${number(time)} s`;
    $("count").textContent = `frame ${frame + 1} of ${times.length}`;
    panels.forEach((mark) => mark(time));
    tell();
    stale = true;
  }

  function play(on) {
    if (on && frame === last) show(0);
    clock = on && last > 0 ? { moment: performance.now(), time: times[frame] } : null;
    $("play").textContent = clock ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", clock ? "Pause" : "Play");
  }

  const name = $("name");
  function tell() {
    const found = chosen.particle !== undefined || chosen.spring !== undefined;
    name.hidden = !found;
    if (found) name.replaceChildren(...describe(data, frame, chosen).map((line) => Object.assign(document.createElement("span"), { textContent: line })));
  }

  function advance(moment) {
    if (clock) {
      const time = clock.time + ((moment - clock.moment) / 1000) * speed;
      const next = lastBefore(times, time);
      if (next !== frame) show(next);
      // The end stays for a moment, then it begins again.
      if (time > times[last] + 0.7 * speed) {
        clock = { moment, time: times[0] };
        show(0);
      }
    }
    if (stale) {
      stale = false;
      paint(frame, projection(), style, chosen);
      draws++;
    }
    requestAnimationFrame(advance);
  }

  function resize() {
    // The picture that prints is the one that was seen.
    if (document.documentElement.classList.contains("printing")) return;
    const { width, height } = canvas.getBoundingClientRect();
    const ratio = Math.min(devicePixelRatio || 1, 2);
    [canvas.width, canvas.height] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
    [camera.width, camera.height] = [width, height];
    style = { ...readStyle(), ratio };
    fitCamera();
    look();
  }

  // After a change of the view.
  function look() {
    stale = true;
    const { scale, rows } = projection();
    scaleBar(scale);
    compass(rows);
  }

  gestures(canvas, look, (point, reach, keep) => {
    if (pinned && !keep) return;
    const found = pick(data, frame, projection(), point, reach);
    chosen = found ?? {};
    pinned = keep && found !== null;
    tell();
    stale = true;
  });

  $("slider").max = last;
  $("slider").addEventListener("input", () => show(Number($("slider").value), true));
  $("play").addEventListener("click", () => play(!clock));
  $("back").addEventListener("click", () => (play(false), show(frame - 1)));
  $("forward").addEventListener("click", () => (play(false), show(frame + 1)));
  $("fit").addEventListener("click", () => (resetCamera(), look()));
  for (const value of about.speeds) {
    const label = value >= 1 || value < 1e-5 ? `${number(value)}×` : `1/${number(1 / value)}×`;
    element("option", value === speed ? { value, selected: "" } : { value }, $("speed")).textContent = label;
  }
  $("speed").addEventListener("change", () => {
    speed = Number($("speed").value);
    if (clock) clock = { moment: performance.now(), time: times[frame] };
  });
  for (const what of Object.keys(switches)) {
    const box = $(what);
    box?.addEventListener("change", () => {
      switches[what] = box.checked;
      resize();
    });
  }
  const keys = {
    " ": () => play(!clock),
    ArrowLeft: () => (play(false), show(frame - 1)),
    ArrowRight: () => (play(false), show(frame + 1)),
    Home: () => (play(false), show(0)),
    End: () => (play(false), show(last)),
    "+": () => (magnify(1.25), look()),
    "-": () => (magnify(0.8), look()),
    f: () => (resetCamera(), look()),
    Escape: () => ((chosen = {}), (pinned = false), tell(), (stale = true)),
  };
  const turns = { ArrowLeft: [-30, 0], ArrowRight: [30, 0], ArrowUp: [0, -30], ArrowDown: [0, 30] };
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.("select, summary")) return;
    const onPicture = event.target === canvas && (event.shiftKey || event.key.endsWith("Up") || event.key.endsWith("Down"));
    const act = onPicture && turns[event.key] ? () => (orbit(...turns[event.key]), look()) : keys[event.key];
    // Buttons and boxes keep the space bar, the slider its own keys.
    if (!act || (event.key === " " && event.target.matches?.("button, input[type=checkbox]"))) return;
    event.preventDefault();
    act();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", resize);
  new ResizeObserver(resize).observe(canvas);
  // Paper is white: the picture is drawn anew at once, since nothing is drawn while it prints.
  for (const [event, printing] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(event, () => {
      document.documentElement.classList.toggle("printing", printing);
      style = { ...style, ...readStyle(), ratio: style.ratio };
      paint(frame, projection(), style, chosen);
    });
  }

  visit(data);
  resetCamera();
  resize();
  show(0);
  // For scripts: the state of the page, and where a particle is in the window.
  globalThis.viewer = {
    show: (next) => show(next, true),
    where: (i) => locate(canvas, data, frame, projection(), i),
    get frame() { return frame; },
    get draws() { return draws; },
    get playing() { return clock !== null; },
    loaded: performance.now() - began,
  };
  if (last > 0 && !matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);
  requestAnimationFrame(advance);
  document.documentElement.dataset.ready = "";
}
