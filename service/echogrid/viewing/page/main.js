// The page: what comes from the server goes to the map and the panel, what the hands do to the sight.
import { CellMap, MODES } from "./map.js";
import { Controls } from "./controls.js";
import { drawCar, drawFields, drawGrid, drawPoints, drawRuler, drawTrail } from "./layers.js";
import { Link } from "./link.js";
import { Panel } from "./panel.js";
import { Sight } from "./sight.js";
import { Timeline } from "./timeline.js";
import { KIND } from "./wire.js";

const by = (id) => document.getElementById(id);
const BODY = { length: 4.9, width: 1.9, rear_overhang: 1.0 };
const MOST_TRAIL = 20000; // numbers, two for a point

class Page {
  constructor() {
    this.canvas = by("picture");
    this.context = this.canvas.getContext("2d");
    this.map = new CellMap();
    this.sight = new Sight();
    this.panel = new Panel();
    this.layers = { map: true, points: true, fov: true, trail: true, truth: true, grid: false };
    this.source = null; // the last HELLO
    this.cell = null;
    this.pose = null;
    this.points = null;
    this.parts = [];
    this.bad = new Set();
    this.trail = [];
    this.truth = [];
    this.ruler = null; // x0, y0, x1, y1 in m
    this.follow = true;
    this.headingUp = false;
    this.poses = []; // when the newest came, ms
    this.drawn = 0; // pictures since the start
    this.received = 0; // bytes
    this.dirty = true;
    this.link = new Link({ hear: (frame, bytes) => this.hear(frame, bytes), tell: (state, why) => this.tell(state, why), begin: () => this.begin() });
    this.timeline = new Timeline(this);
    this.controls = new Controls(this);
    this.setTheme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    setInterval(() => this.everySecond(), 1000);
    requestAnimationFrame(() => this.draw());
  }

  // ---- what comes ----

  begin() {
    const clock = this.timeline.clock;
    return { ...(this.token() ? { token: this.token() } : {}), ...(clock ? { seek: clock.at, playing: clock.playing, speed: clock.speed } : {}) };
  }

  token() {
    const given = new URLSearchParams(location.hash.slice(1)).get("token");
    if (given) {
      sessionStorage.setItem("token", given);
      history.replaceState(null, "", location.pathname); // out of sight
    }
    return sessionStorage.getItem("token");
  }

  hear(frame, bytes) {
    this.received += bytes;
    this.dirty = true;
    switch (frame.kind) {
      case KIND.HELLO:
        return this.hello(frame);
      case KIND.RESET:
        this.map.clear();
        [this.trail, this.points] = [[], null];
        return;
      case KIND.BLOCKS:
        this.map.put(frame.plane, frame.blocks);
        if (this.source?.shown === "map") this.wholeMapSoon();
        return;
      case KIND.POSE:
        return this.move(frame);
      case KIND.POINTS:
        return this.detect(frame);
      case KIND.STATUS:
        this.parts = frame.parts;
        this.panel.status(frame, this.now());
        this.showRadars();
        return;
      case KIND.TRAIL:
        if (frame.true) this.truth = frame.places;
        else this.trail = Array.from(frame.places);
        return;
      case KIND.CLOCK:
        return this.timeline.hear(frame);
    }
  }

  hello(frame) {
    this.source = frame;
    this.cell = frame.cell ?? this.cell;
    this.panel.hello(frame);
    this.timeline.hello(frame);
    this.showRadars();
    if (!frame.planes.includes({ source: "SOURCE", age: "SEEN", truth: "TRUTH" }[this.map.mode] ?? "OCCUPANCY")) this.setMode("probability");
    const own = document.querySelector('#layers input[name="truth"]');
    own.disabled = !frame.truth;
  }

  move(frame) {
    this.pose = frame;
    const count = this.trail.length;
    if (!count || Math.hypot(frame.x - this.trail[count - 2], frame.y - this.trail[count - 1]) > 0.3) this.trail.push(frame.x, frame.y);
    if (this.trail.length > MOST_TRAIL) this.trail.splice(0, 2);
    const now = performance.now();
    this.poses.push(now);
    while (this.poses[0] < now - 2000) this.poses.shift();
    this.panel.pose(frame);
    this.panel.graphs.speed.add(this.now(), frame.speed);
    this.canvas.setAttribute("aria-label", `Map around the car at ${frame.x.toFixed(0)}, ${frame.y.toFixed(0)} m, seen from above`);
  }

  detect(frame) {
    this.points = frame;
    const [verdicts, radars] = [[0, 0, 0], []];
    frame.verdicts.forEach((verdict) => verdicts[verdict]++);
    frame.radars.forEach((radar) => (radars[radar] = (radars[radar] ?? 0) + 1));
    this.radarCounts = radars;
    this.panel.detections(radars, verdicts, this.now());
  }

  tell(state, why) {
    const notice = by("notice");
    notice.hidden = state === "open";
    by("ask").hidden = state !== "token";
    if (state === "token") by("refused").textContent = why;
    if (state !== "open") {
      notice.textContent = state === "token" ? "a token is needed" : `not connected: ${why}; trying again …`;
      this.panel.state("silent", "not connected", []);
      this.poses = [];
    }
  }

  /** s, for the graphs: of the drive, or by this machine's clock while it is live. */
  now() {
    return this.source?.timeline && this.pose ? this.pose.stamp : performance.now() / 1000;
  }

  everySecond() {
    this.panel.counts(this.map.counts());
    this.panel.mapAge(this.poses.length ? (performance.now() - this.poses.at(-1)) / 1000 : null);
    this.showRadars();
    if (this.poses.length) this.panel.graphs.maps.add(this.now(), this.poses.filter((at) => at > performance.now() - 2000).length / 2);
    if (this.map.mode === "age" && this.source?.shown !== "map") {
      this.map.show({ now: this.pose?.stamp ?? 0 });
      this.dirty = true;
    }
  }

  showRadars() {
    this.bad = this.panel.showRadars(this.theme, this.radarCounts ?? [], this.parts);
  }

  wholeMapSoon() {
    clearTimeout(this.fitting);
    this.fitting = setTimeout(() => {
      this.map.show({ now: this.map.seen[1], old: Math.max(this.map.seen[1] - this.map.seen[0], 1) });
      this.timeline.ages(this.map.seen);
      this.wholeMap();
    }, 50);
  }

  // ---- what the hands do ----

  setTheme(theme) {
    this.theme = document.documentElement.dataset.theme = theme;
    localStorage.setItem("theme", theme);
    this.map.show({ theme });
    this.panel.legend(this.map.mode, theme, this.source?.shown === "map");
    this.panel.redraw();
    this.showRadars();
    this.dirty = true;
  }

  setMode(mode) {
    const input = document.querySelector(`#modes input[value="${mode}"]`);
    if (input.disabled) return;
    input.checked = true;
    this.map.show({ mode, now: this.source?.shown === "map" ? this.map.seen[1] : (this.pose?.stamp ?? 0) });
    this.panel.legend(mode, this.theme, this.source?.shown === "map");
    this.dirty = true;
  }

  nextMode() {
    const open = MODES.filter((mode) => !document.querySelector(`#modes input[value="${mode}"]`).disabled);
    this.setMode(open[(open.indexOf(this.map.mode) + 1) % open.length]);
  }

  setLayer(name, shown) {
    const input = document.querySelector(`#layers input[name="${name}"]`);
    this.layers[name] = input.checked = shown;
    this.dirty = true;
  }

  setFollow(follow, headingUp = this.headingUp) {
    [this.follow, this.headingUp] = [follow, headingUp];
    if (!headingUp) this.sight.turn = 0;
    by("follow").setAttribute("aria-pressed", follow);
    by("heading").setAttribute("aria-pressed", headingUp);
    this.dirty = true;
  }

  wholeMap() {
    const bounds = this.cell && this.map.bounds(this.cell);
    if (!bounds) return;
    this.setFollow(false, false);
    this.sight.fit(bounds);
  }

  // ---- the picture ----

  resize() {
    const ratio = window.devicePixelRatio;
    [this.sight.width, this.sight.height] = [Math.max(this.canvas.clientWidth, 1), Math.max(this.canvas.clientHeight, 1)];
    [this.canvas.width, this.canvas.height] = [this.sight.width * ratio, this.sight.height * ratio];
    this.dirty = true;
  }

  draw() {
    requestAnimationFrame(() => this.draw());
    if (!this.dirty) return;
    this.dirty = false;
    this.drawn++;
    const { context, sight, theme, layers, pose } = this;
    if (pose && this.follow) {
      [sight.x, sight.y] = [pose.x, pose.y];
      if (this.headingUp) sight.turn = Math.PI / 2 - pose.yaw;
    }
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    sight.apply(context, window.devicePixelRatio);
    if (layers.map && this.cell) this.map.draw(context, this.cell, sight.visible(), sight.scale);
    if (layers.grid) drawGrid(context, sight, theme);
    if (layers.truth && this.truth.length) drawTrail(context, sight, theme, this.truth, true);
    if (layers.trail) drawTrail(context, sight, theme, this.trail, false);
    if (pose) {
      if (layers.fov && this.source?.radars) drawFields(context, sight, theme, pose, this.source.radars, this.bad);
      if (layers.points && this.points) drawPoints(context, sight, theme, this.points);
      drawCar(context, sight, theme, pose, this.source?.body ?? BODY);
    }
    if (this.ruler) drawRuler(context, sight, theme, this.ruler);
    this.controls.scaleBar();
  }
}

window.echogrid = new Page();
