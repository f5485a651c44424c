// Small graphs of the last minute.
const SPAN = 60; // s

export class Graph {
  constructor(parent, title, unit) {
    this.values = []; // [s, value]
    this.unit = unit;
    const figure = document.createElement("figure");
    const caption = figure.appendChild(document.createElement("figcaption"));
    caption.append(title, (this.number = document.createElement("b")));
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("aria-hidden", "true"); // the number beside it says it
    figure.append(this.canvas);
    parent.append(figure);
    figure.hidden = true;
    this.figure = figure;
  }

  add(at, value) {
    if (!Number.isFinite(value)) return;
    if (this.values.length && at < this.values.at(-1)[0]) this.values = []; // sought back
    this.values.push([at, value]);
    while (this.values[0][0] < at - SPAN) this.values.shift();
    this.figure.hidden = false;
    this.number.textContent = `${format(value)} ${this.unit}`;
    this.draw();
  }

  clear() {
    this.values = [];
    this.figure.hidden = true;
  }

  draw() {
    const { canvas, values } = this;
    const ratio = window.devicePixelRatio;
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio];
    if (!width || !values.length) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const context = canvas.getContext("2d");
    const style = getComputedStyle(document.documentElement);
    context.clearRect(0, 0, width, height);
    const most = Math.max(...values.map(([, value]) => value), 1e-9) * 1.15;
    const [newest] = values.at(-1);
    const point = ([at, value]) => [width - ((newest - at) / SPAN) * width, height - 1 - (value / most) * (height - 2)];
    context.strokeStyle = style.getPropertyValue("--line");
    context.lineWidth = ratio;
    context.beginPath();
    context.moveTo(0, height - ratio / 2);
    context.lineTo(width, height - ratio / 2);
    context.stroke();
    context.strokeStyle = style.getPropertyValue("--accent");
    context.lineWidth = 1.8 * ratio;
    context.beginPath();
    values.forEach((value, n) => (n ? context.lineTo(...point(value)) : context.moveTo(...point(value))));
    context.stroke();
  }
}

export function format(value) {
  return Math.abs(value) >= 100 ? value.toFixed(0) : value.toFixed(1);
}
