// Words and numbers around the picture.
import { Graph, format } from "./graphs.js";
import { COLOURS } from "./map.js";
import { radarColour } from "./layers.js";

const by = (id) => document.getElementById(id);
const DEGREES = 180 / Math.PI;

export class Panel {
  constructor() {
    const graph = (title, unit) => new Graph(by("graphs"), title, unit);
    this.graphs = {
      maps: graph("maps shown", "/s"),
      map_hz: graph("map updates", "/s"),
      frames_hz: graph("CAN frames", "/s"),
      p50: graph("latency", "ms"),
      p99: graph("99 % within", "ms"),
      static: graph("static", ""),
      moving: graph("moving", ""),
      speed: graph("speed", "m/s"),
    };
    this.radars = [];
  }

  hello({ name, shown, vehicle, planes, radars, model, epoch }) {
    by("source").textContent = shown === "live" ? name : `${name}${vehicle ? `, ${vehicle}` : ""}`;
    by("source").title = model ?? "";
    document.title = `echogrid – ${name}`;
    const needs = { source: "SOURCE", age: "SEEN", truth: "TRUTH" };
    for (const input of document.querySelectorAll("#modes input")) {
      const missing = needs[input.value] && !planes.includes(needs[input.value]);
      input.disabled = missing;
      input.parentElement.title = missing ? (shown === "live" ? "the topics do not carry it" : "not known here") : "";
    }
    this.radars = radars ?? [];
    for (const id of ["h-car", "h-radars", "h-graphs"]) by(id).parentElement.hidden = shown === "map";
    by("n-epoch").textContent = epoch ?? "–";
    if (shown === "map") this.state("map", "stored map", []);
  }

  state(state, text, reasons) {
    const pill = by("state");
    pill.dataset.state = state;
    if (pill.textContent !== text) pill.textContent = text; // a screen reader says what changes, and only that
    by("reasons").replaceChildren(...reasons.map((reason) => element("li", reason)));
  }

  status(status, at) {
    this.state(status.state, status.state.replace("_", " "), status.reasons ?? []);
    by("n-epoch").textContent = status.epoch ?? "–";
    for (const [key, value] of Object.entries({ ...status.rates, ...status.latency_ms })) if (key in this.graphs) this.graphs[key].add(at, value);
  }

  /** `counts`: detections of each radar in the newest map; `parts`: levels of the status; the names of those that are bad. */
  showRadars(theme, counts, parts) {
    const bad = new Set();
    const rows = this.radars.map((radar, number) => {
      const part = parts.find(({ name }) => name === `radar ${radar.name}`);
      const row = document.createElement("li");
      const dot = row.appendChild(document.createElement("i"));
      dot.style.background = radarColour(number, theme);
      row.append(element("span", radar.name.replaceAll("_", " "), "name"), element("span", counts[number] ?? 0, "count"));
      if (part && part.level === 1) {
        bad.add(radar.name);
        row.className = "bad";
        row.append(element("span", part.said, "said"));
      }
      return row;
    });
    by("radars").replaceChildren(...rows);
    return bad;
  }

  pose({ x, y, yaw, speed, yawRate }) {
    by("n-speed").textContent = `${format(speed)} m/s, ${format(speed * 3.6)} km/h`;
    by("n-yaw-rate").textContent = `${format(yawRate * DEGREES)} °/s`;
    by("n-place").textContent = `${x.toFixed(1)}, ${y.toFixed(1)} m`;
    by("n-yaw").textContent = `${(yaw * DEGREES).toFixed(1)}°`;
  }

  /** How many detections there are by radar and by verdict; one map's, at once. */
  detections(radars, verdicts, at) {
    document.querySelectorAll("#radars .count").forEach((count, number) => (count.textContent = radars[number] ?? 0));
    ["static", "moving", "beside"].forEach((name, verdict) => (by(`c-${name}`).textContent = verdicts[verdict]));
    this.graphs.static.add(at, verdicts[0]);
    this.graphs.moving.add(at, verdicts[1]);
  }

  counts({ known, occupied }) {
    by("n-known").textContent = known.toLocaleString("en");
    by("n-occupied").textContent = occupied.toLocaleString("en");
  }

  mapAge(seconds) {
    by("n-map-age").textContent = seconds === null ? "–" : `${seconds.toFixed(1)} s ago`;
  }

  /** `stored`: ages are those of a whole map. */
  legend(mode, theme, stored) {
    const { free, occupied, learned, newest, oldest } = COLOURS[theme];
    const shown = {
      probability: [["free", free], ["even", mix(free, occupied, 0.5)], ["occupied", occupied]],
      source: [["measured", mix(free, occupied, 0.15)], ["learned only", mix(free, learned, 0.55)]],
      age: stored ? [["newest", newest], ["oldest, or not known", oldest]] : [["just now", newest], ["a minute ago or more", oldest]],
      truth: [["free", free], ["occupied", occupied]],
    }[mode];
    by("legend").replaceChildren(
      ...shown.map(([text, colour]) => {
        const item = document.createElement("span");
        item.appendChild(document.createElement("i")).style.background = `rgb(${colour})`;
        item.append(text);
        return item;
      }),
    );
  }

  redraw() {
    for (const graph of Object.values(this.graphs)) graph.draw();
  }

  clear() {
    for (const graph of Object.values(this.graphs)) graph.clear();
  }
}

function mix(a, b, share) {
  return a.map((value, n) => Math.round(value + (b[n] - value) * share));
}

function element(name, text, className = "") {
  const made = document.createElement(name);
  made.textContent = text;
  made.className = className;
  return made;
}
