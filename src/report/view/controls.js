// The page of a motion: buttons, slider and keys that choose its frame.

async function start() {
  const began = performance.now();
  const data = await load();
  const { times, clock: [symbol, unit] } = about;
  const last = times.length - 1;
  let frame = 0;
  let clock = null; // while it plays: the moment and the time of the motion at which it began
  let speed = about.speed;
  visit(data);
  const picture = stage(data, () => frame);

  const panels = [];
  const seek = (time) => show(lastBefore(times, time), true);
  about.tracks.forEach((one) => panels.push(track($("tracks"), one, seek)));

  function show(next, byHand) {
    frame = Math.min(last, Math.max(0, next));
    if (byHand && clock) clock = { moment: performance.now(), time: times[frame] };
    const time = times[frame];
    const told = `${symbol} = ${number(time)} ${unit}`.trim();
    $("slider").value = frame;
    $("slider").setAttribute("aria-valuetext", told);
    $("time").textContent = told;
    $("count").textContent = `frame ${frame + 1} of ${times.length}`;
    panels.forEach((mark) => mark(time));
    picture.changed();
  }

  function play(on) {
    if (on && frame === last) show(0);
    clock = on && last > 0 ? { moment: performance.now(), time: times[frame] } : null;
    $("play").textContent = clock ? "❚❚" : "▶";
    $("play").setAttribute("aria-label", clock ? "Pause" : "Play");
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
    picture.draw();
    requestAnimationFrame(advance);
  }

  $("slider").max = last;
  $("slider").addEventListener("input", () => show(Number($("slider").value), true));
  $("play").addEventListener("click", () => play(!clock));
  $("back").addEventListener("click", () => (play(false), show(frame - 1)));
  $("forward").addEventListener("click", () => (play(false), show(frame + 1)));
  for (const value of about.speeds) {
    const label = value >= 1 || value < 1e-5 ? `${number(value)}×` : `1/${number(1 / value)}×`;
    element("option", value === speed ? { value, selected: "" } : { value }, $("speed")).textContent = label;
  }
  $("speed").addEventListener("change", () => {
    speed = Number($("speed").value);
    if (clock) clock = { moment: performance.now(), time: times[frame] };
  });
  picture.watch({
    " ": () => play(!clock),
    ArrowLeft: () => (play(false), show(frame - 1)),
    ArrowRight: () => (play(false), show(frame + 1)),
    Home: () => (play(false), show(0)),
    End: () => (play(false), show(last)),
  });

  show(0);
  // For scripts: the state of the page, and where a particle is in the window.
  globalThis.viewer = {
    show: (next) => show(next, true),
    where: (i) => locate(canvas, data, frame, projection(), i),
    get frame() { return frame; },
    get draws() { return picture.draws; },
    get playing() { return clock !== null; },
    loaded: performance.now() - began,
  };
  if (last > 0 && !still()) play(true);
  requestAnimationFrame(advance);
  document.documentElement.dataset.ready = "";
}
