// The picture on the page: what is drawn and when, what is pointed at, switches and printing.

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

// `shown()` is the number of the frame to draw. Returns `changed`, to be called when that or its places change, `draw`, to be called at
// every refresh of the screen, and `watch`, which starts to listen to keys: those of the picture and those given.
function stage(data, shown) {
  const paint = painter(canvas, data);
  const name = $("name");
  let style = readStyle();
  let chosen = {};
  let pinned = false;
  let stale = true;
  let draws = 0;

  function changed() {
    const found = chosen.particle !== undefined || chosen.spring !== undefined;
    name.hidden = !found;
    if (found) name.replaceChildren(...describe(data, shown(), chosen).map((line) => Object.assign(document.createElement("span"), { textContent: line })));
    stale = true;
  }

  function draw() {
    if (!stale) return;
    stale = false;
    paint(shown(), projection(), style, chosen);
    draws++;
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

  // A canvas of another size is blank: it is drawn on before it is shown.
  function redraw() {
    resize();
    draw();
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
    const found = pick(data, shown(), projection(), point, reach);
    chosen = found ?? {};
    pinned = keep && found !== null;
    changed();
  });
  $("fit").addEventListener("click", () => (resetCamera(), look()));
  for (const what of Object.keys(switches)) {
    const box = $(what);
    box?.addEventListener("change", () => {
      switches[what] = box.checked;
      resize();
    });
  }
  const turns = { ArrowLeft: [-30, 0], ArrowRight: [30, 0], ArrowUp: [0, -30], ArrowDown: [0, 30] };

  function watch(others) {
    const keys = {
      "+": () => (magnify(1.25), look()),
      "-": () => (magnify(0.8), look()),
      f: () => (resetCamera(), look()),
      Escape: () => ((chosen = {}), (pinned = false), changed()),
      ...others,
    };
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.("select, summary")) return;
      const onPicture = event.target === canvas && (event.shiftKey || event.key.endsWith("Up") || event.key.endsWith("Down"));
      const act = onPicture && turns[event.key] ? () => (orbit(...turns[event.key]), look()) : keys[event.key];
      // Buttons and boxes keep the space bar, the slider its own keys.
      if (!act || (event.key === " " && event.target.matches?.("button, input[type=checkbox]"))) return;
      event.preventDefault();
      act();
    });
  }

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  new ResizeObserver(redraw).observe(canvas);
  // Paper is white: the picture is drawn anew at once, since nothing is drawn while it prints.
  for (const [event, printing] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(event, () => {
      document.documentElement.classList.toggle("printing", printing);
      style = { ...style, ...readStyle(), ratio: style.ratio };
      paint(shown(), projection(), style, chosen);
    });
  }

  resetCamera();
  resize();
  return { changed, draw, watch, get draws() { return draws; } };
}

const still = () => matchMedia("(prefers-reduced-motion: reduce)").matches;
