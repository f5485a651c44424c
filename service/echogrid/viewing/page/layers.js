// What lies over the map, drawn in metres: grid, trails, fields of view, detections, the car, the ruler.
export const RADAR_COLOURS = {
  light: ["#0072b2", "#b34a00", "#00795a", "#a03378", "#6a5400", "#4b3fa8"], // told apart by colour-blind eyes too
  dark: ["#56b4e9", "#f0904c", "#3fd0a4", "#e58fc0", "#e0cf5a", "#a9a0ff"],
};
const INK = { light: "#14202b", dark: "#eef2f6" };
const DRIVEN = { light: "#d1401b", dark: "#ff8a5c" };
const TRUE = { light: "#00695c", dark: "#5fe0c8" };
const BAD = { light: "#b3261e", dark: "#ff8a80" };
const [STATIC, MOVING] = [0, 1];

export function radarColour(number, theme) {
  return RADAR_COLOURS[theme][number % RADAR_COLOURS[theme].length];
}

export function drawGrid(context, sight, theme) {
  const [x0, y0, x1, y1] = sight.visible();
  const step = sight.scale < 1 ? 100 : 10;
  context.beginPath();
  for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) line(context, x, y0, x, y1);
  for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) line(context, x0, y, x1, y);
  stroke(context, sight, INK[theme], 0.6, 0.35);
}

/** `places`: x, y of each. */
export function drawTrail(context, sight, theme, places, true_) {
  if (places.length < 4) return;
  context.beginPath();
  context.moveTo(places[0], places[1]);
  for (let n = 2; n < places.length; n += 2) context.lineTo(places[n], places[n + 1]);
  if (true_) context.setLineDash([6 / sight.scale, 4 / sight.scale]);
  stroke(context, sight, (true_ ? TRUE : DRIVEN)[theme], true_ ? 1.8 : 2.5, 1);
  context.setLineDash([]);
}

/** Each radar's field of view; `bad`: names of those that something is wrong with. */
export function drawFields(context, sight, theme, pose, radars, bad) {
  radars.forEach((radar, number) => {
    const [x, y] = placed(pose, radar.x, radar.y);
    const [middle, half] = [pose.yaw + (radar.yaw_deg * Math.PI) / 180, (radar.fov_deg * Math.PI) / 360];
    const wrong = bad.has(radar.name);
    context.beginPath();
    context.moveTo(x, y);
    context.arc(x, y, radar.max_range, middle - half, middle + half);
    context.closePath();
    context.fillStyle = wrong ? BAD[theme] : radarColour(number, theme);
    context.globalAlpha = wrong ? 0.25 : 0.05;
    context.fill();
    context.globalAlpha = 1;
    stroke(context, sight, wrong ? BAD[theme] : radarColour(number, theme), wrong ? 2.5 : 1, wrong ? 1 : 0.5);
  });
}

export function drawPoints(context, sight, theme, { places, radars, verdicts }) {
  const size = Math.max(4, Math.min(8, sight.scale * 0.3)) / sight.scale; // m
  for (let n = 0; n < radars.length; n++) {
    const [x, y] = [places[2 * n], places[2 * n + 1]];
    const colour = radarColour(radars[n], theme);
    context.beginPath();
    if (verdicts[n] === STATIC) {
      context.arc(x, y, size * 0.6, 0, 2 * Math.PI);
      fillWithRim(context, sight, theme, colour);
    } else if (verdicts[n] === MOVING) {
      context.moveTo(x, y + size * 1.3);
      context.lineTo(x - size, y - size * 0.7);
      context.lineTo(x + size, y - size * 0.7);
      context.closePath();
      fillWithRim(context, sight, theme, colour);
    } else {
      line(context, x - size * 0.7, y - size * 0.7, x + size * 0.7, y + size * 0.7);
      line(context, x - size * 0.7, y + size * 0.7, x + size * 0.7, y - size * 0.7);
      stroke(context, sight, colour, 2, 1);
    }
  }
}

export function drawCar(context, sight, theme, pose, body) {
  const { length, width, rear_overhang: rear } = body;
  const corners = [[-rear, -width / 2], [length - rear, -width / 2], [length - rear, width / 2], [-rear, width / 2]];
  outline(context, corners.map(([x, y]) => placed(pose, x, y)));
  context.fillStyle = DRIVEN[theme];
  context.globalAlpha = 0.85;
  context.fill();
  context.globalAlpha = 1;
  stroke(context, sight, INK[theme], 1.2, 1);
  const nose = length - rear;
  outline(context, [[nose - 0.3, 0], [nose - 1.5, -width * 0.3], [nose - 1.5, width * 0.3]].map(([x, y]) => placed(pose, x, y)));
  context.fillStyle = theme === "light" ? "#fff" : "#14181e";
  context.fill();
}

export function drawRuler(context, sight, theme, [x0, y0, x1, y1]) {
  context.beginPath();
  line(context, x0, y0, x1, y1);
  stroke(context, sight, theme === "light" ? "#fff" : "#000", 5, 0.8);
  context.beginPath();
  line(context, x0, y0, x1, y1);
  stroke(context, sight, INK[theme], 2, 1);
  const [px, py] = sight.toScreen((x0 + x1) / 2, (y0 + y1) / 2);
  const ratio = window.devicePixelRatio;
  context.setTransform(ratio, 0, 0, ratio, px * ratio, py * ratio);
  context.font = "bold 16px system-ui, sans-serif";
  context.textAlign = "center";
  context.lineWidth = 5;
  context.strokeStyle = theme === "light" ? "#fff" : "#000";
  context.fillStyle = INK[theme];
  const text = `${Math.hypot(x1 - x0, y1 - y0).toFixed(2)} m`;
  context.strokeText(text, 0, -10);
  context.fillText(text, 0, -10);
}

export function placed(pose, x, y) {
  const [c, s] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
  return [pose.x + c * x - s * y, pose.y + s * x + c * y];
}

function outline(context, corners) {
  context.beginPath();
  corners.forEach(([x, y], n) => (n ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.closePath();
}

function line(context, x0, y0, x1, y1) {
  context.moveTo(x0, y0);
  context.lineTo(x1, y1);
}

/** `width` in pixels. */
function stroke(context, sight, colour, width, alpha) {
  context.strokeStyle = colour;
  context.lineWidth = width / sight.scale;
  context.globalAlpha = alpha;
  context.stroke();
  context.globalAlpha = 1;
}

function fillWithRim(context, sight, theme, colour) {
  context.fillStyle = colour;
  context.fill();
  stroke(context, sight, theme === "light" ? "#fff" : "#14181e", 1, 0.9);
}
