addEventListener("load", () => {
  const problems = [];
  let pictures = 0, texts = 0;
  const frames = [...document.querySelectorAll("iframe")];

  const channels = colour => {
    const parts = colour.match(/[\d.]+/g).map(Number);
    return colour.startsWith("color(srgb") ? [...parts.slice(0, 3).map(c => 255 * c), parts[3] ?? 1] : [...parts.slice(0, 3), parts[3] ?? 1];
  };
  const luminance = colour => {
    const [r, g, b] = channels(colour).map(c => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const contrast = (a, b) => {
    const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
    return (high + 0.05) / (low + 0.05);
  };

  for (const frame of frames) {
    const page = frame.contentDocument, view = frame.contentWindow, width = Number(frame.width);
    const say = text => problems.push(`${width} px: ${text}`);
    const shown = element => element.checkVisibility({ visibilityProperty: true, contentVisibilityAuto: true });
    const describe = element => `<${element.localName}${element.className ? " class=" + (element.className.baseVal ?? element.className) : ""}> ${(element.textContent || "").trim().slice(0, 40)}`;
    // What is folded away is looked at too.
    for (const details of page.querySelectorAll("details")) details.open = true;
    // A hidden scroll bar takes no room, so the width of the frame is that of the page.
    if (page.documentElement.scrollWidth > width) {
      const wide = [...page.body.querySelectorAll("*")].find(e => shown(e) && !e.closest(".scroll, svg, .skip") && e.getBoundingClientRect().right > width + 1);
      say(`wider than the page, ${page.documentElement.scrollWidth} px: ${wide ? describe(wide) : "?"}`);
    }
    for (const svg of page.querySelectorAll("svg")) {
      if (svg.closest("[aria-hidden=true]")) continue;
      pictures += 1;
      if (svg.getAttribute("role") !== "img" || !(svg.getAttribute("aria-label") || "").trim()) say(`picture without a text: ${describe(svg)}`);
    }
    for (const canvas of page.querySelectorAll("canvas")) {
      pictures += 1;
      if (canvas.getAttribute("role") !== "img" || !(canvas.getAttribute("aria-label") || "").trim()) say(`canvas without a text: ${canvas.id}`);
    }
    for (const image of page.querySelectorAll("img")) {
      pictures += 1;
      if (!image.getAttribute("alt")) say("image without alt");
    }
    for (const region of page.querySelectorAll(".scroll")) {
      if (region.tabIndex < 0 || !region.getAttribute("aria-label")) say(`table that the keyboard cannot scroll: ${describe(region)}`);
    }
    // Every table fits on a phone.
    for (const region of page.querySelectorAll(".scroll")) {
      if (region.scrollWidth > region.clientWidth) say(`table that scrolls sideways, ${region.scrollWidth} px in ${region.clientWidth}: ${region.getAttribute("aria-label")}`);
    }
    for (const field of page.querySelectorAll("select, input")) {
      if (!field.labels.length && !field.getAttribute("aria-label")) say(`field without a label: ${field.id}`);
    }
    const ids = [...page.querySelectorAll("[id]")].map(element => element.id);
    if (new Set(ids).size < ids.length) say("an id that is given twice");

    const faint = new Set();
    const walker = page.createTreeWalker(page.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
      const element = node.parentElement;
      if (!node.textContent.trim() || element.closest("svg, style, script, option, .skip") || !shown(element)) continue;
      texts += 1;
      const style = view.getComputedStyle(element);
      let ground = element;
      while (ground && channels(view.getComputedStyle(ground).backgroundColor)[3] === 0) ground = ground.parentElement;
      const paper = ground ? view.getComputedStyle(ground).backgroundColor : "rgb(255, 255, 255)";
      const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
      const ratio = contrast(style.color, paper);
      if (ratio < (large ? 3 : 4.5)) faint.add(`contrast ${ratio.toFixed(2)} of ${style.color} on ${paper}: ${describe(element)}`);
    }
    [...faint].slice(0, 5).forEach(say);

    const verdict = page.querySelector("#verdict");
    if (verdict) {
      const rows = () => [...page.querySelectorAll("tr[id^=check-]")];
      const visible = () => rows().filter(row => row.getClientRects().length > 0);
      const failed = rows().filter(row => row.classList.contains("failed-row"));
      verdict.value = "failed";
      if (visible().length !== failed.length || !visible().every(row => failed.includes(row))) say(`the filter shows ${visible().length} rows of ${failed.length} that failed`);
      verdict.value = "";
      const scene = page.querySelector("#scene");
      scene.value = "0";
      const wanted = rows().filter(row => row.dataset.s === "0");
      if (visible().length !== wanted.length || !visible().every(row => wanted.includes(row))) say(`the filter shows ${visible().length} rows of ${wanted.length} on a scene`);
      scene.value = "";
      const family = page.querySelector("#family"), sections = [...page.querySelectorAll("section.claim")];
      family.value = sections[0].id;
      if (sections.filter(shown).length !== 1) say("the filter does not show one family alone");
    }
  }
  document.querySelector("#found").textContent = JSON.stringify({ problems, pictures, texts, frames: frames.length, dark: matchMedia("(prefers-color-scheme: dark)").matches });
});
