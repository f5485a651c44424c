// Hands: pointer, wheel, keys, buttons.

const by = (id) => document.getElementById(id);
const STEP = 80; // pixels that an arrow key moves
const SOURCES = ["", ", learned only", ", measured"];

export class Controls {
  constructor(page) {
    this.page = page;
    this.measuring = false;
    this.fingers = new Map(); // pointer's id -> its place
    const { canvas } = page;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => this.fingers.delete(event.pointerId));
    canvas.addEventListener("pointerleave", () => (by("pointer").textContent = ""));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    document.addEventListener("keydown", (event) => this.key(event));
    by("follow").onclick = () => page.setFollow(!page.follow);
    by("heading").onclick = () => page.setFollow(true, !page.headingUp);
    by("fit").onclick = () => page.wholeMap();
    by("ruler").onclick = () => this.measure(!this.measuring);
    by("theme").onclick = () => page.setTheme(page.theme === "light" ? "dark" : "light");
    by("help").onclick = () => this.unfold("help", by("keys").hidden);
    by("fold").onclick = () => this.unfold("fold", document.body.classList.contains("folded"));
    by("modes").onchange = ({ target }) => page.setMode(target.value);
    by("layers").onchange = ({ target }) => page.setLayer(target.name, target.checked);
    by("ask").onsubmit = (event) => {
      event.preventDefault();
      sessionStorage.setItem("token", by("token").value);
      page.link.open();
    };
  }

  unfold(button, open) {
    by(button).setAttribute("aria-expanded", open);
    if (button === "help") by("keys").hidden = !open;
    else document.body.classList.toggle("folded", !open);
  }

  measure(on) {
    this.measuring = on;
    by("ruler").setAttribute("aria-pressed", on);
    document.querySelector("main").classList.toggle("measuring", on);
    if (!on) [this.page.ruler, this.page.dirty] = [null, true];
  }

  place(event) {
    const { left, top } = this.page.canvas.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  }

  down(event) {
    this.page.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, this.place(event));
    if (this.measuring) {
      const [x, y] = this.page.sight.toWorld(...this.place(event));
      this.page.ruler = [x, y, x, y];
    }
  }

  moved(event) {
    const { page } = this;
    const now = this.place(event);
    this.say(now);
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    page.dirty = true;
    if (this.measuring && page.ruler) {
      page.ruler = [...page.ruler.slice(0, 2), ...page.sight.toWorld(...now)];
      return this.say(now);
    }
    if (this.fingers.size === 2) {
      const [other] = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      const [was, is] = [before, now].map((place) => Math.hypot(place[0] - other[0], place[1] - other[1]));
      page.sight.zoom(is / Math.max(was, 1), ...(page.follow ? [] : [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]));
    } else {
      if (page.follow) page.setFollow(false);
      page.sight.pan(now[0] - before[0], now[1] - before[1]);
    }
    this.fingers.set(event.pointerId, now);
  }

  wheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), ...this.place(event));
  }

  zoom(factor, ...place) {
    this.page.sight.zoom(factor, ...(this.page.follow ? [] : place));
    this.page.dirty = true;
  }

  key(event) {
    if (event.target.matches("input[type=password], select") || event.ctrlKey || event.metaKey || event.altKey) return;
    const { page } = this;
    const pan = (dx, dy) => () => {
      page.setFollow(false);
      page.sight.pan(dx, dy);
    };
    const ranged = event.target.matches("input[type=range], input[type=radio]");
    const arrows = ranged ? {} : { ArrowLeft: pan(STEP, 0), ArrowRight: pan(-STEP, 0), ArrowUp: pan(0, STEP), ArrowDown: pan(0, -STEP) };
    const onButton = event.target.matches("button, input");
    const actions = {
      ...arrows,
      f: () => page.setFollow(!page.follow),
      u: () => page.setFollow(true, !page.headingUp),
      0: () => page.wholeMap(),
      "+": () => this.zoom(1.25),
      "=": () => this.zoom(1.25),
      "-": () => this.zoom(0.8),
      r: () => this.measure(!this.measuring),
      m: () => page.nextMode(),
      t: () => by("theme").click(),
      h: () => by("fold").click(),
      "?": () => by("help").click(),
      Escape: () => (this.unfold("help", false), this.measure(false)),
      ",": () => page.timeline.step(-1),
      ".": () => page.timeline.step(1),
      ...(onButton ? {} : { " ": () => page.timeline.toggle() }),
    };
    Object.keys(page.layers).forEach((name, n) => (actions[n + 1] = () => page.setLayer(name, !page.layers[name])));
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
    page.dirty = true;
  }

  /** Where the pointer is, and what the map says there; or how long the ruler is. */
  say([px, py]) {
    const { page } = this;
    const { ruler, cell, map, source } = page;
    if (this.measuring && ruler) {
      const [dx, dy] = [ruler[2] - ruler[0], ruler[3] - ruler[1]];
      by("pointer").textContent = `${Math.hypot(dx, dy).toFixed(2)} m  (${dx.toFixed(2)}, ${dy.toFixed(2)})`;
      return;
    }
    const [x, y] = page.sight.toWorld(px, py);
    const { percent, source: from, seen } = cell ? map.cellAt(x, y, cell) : { percent: -1 };
    const known = percent < 0 ? "never seen" : `${percent} %${SOURCES[from ?? 0]}`;
    const newest = source?.shown === "map" ? 0 : page.pose?.stamp;
    const age = seen && newest ? `, ${Math.max(newest - seen, 0).toFixed(0)} s old` : "";
    by("pointer").textContent = `${x.toFixed(1)}, ${y.toFixed(1)} m: ${known}${percent < 0 ? "" : age}`;
  }

  scaleBar() {
    const length = this.page.sight.rule(140);
    const bar = by("scale").firstElementChild;
    const text = length >= 1 ? `${length} m` : `${length * 100} cm`;
    if (by("scale").dataset.text !== text) {
      by("scale").dataset.text = text;
      by("scale").replaceChildren(text, bar);
    }
    bar.style.width = `${length * this.page.sight.scale}px`;
  }
}

