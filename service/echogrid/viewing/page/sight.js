// From metres in odom to pixels and back: where the eye is. No DOM here.
export const NEAREST = 200; // pixels of a metre
export const FARTHEST = 0.2;

export class Sight {
  constructor() {
    this.x = 0; // m in odom, in the middle of the picture
    this.y = 0;
    this.scale = 12; // pixels of a metre
    this.turn = 0; // rad by which the world is turned counter-clockwise on the screen
    this.width = 1;
    this.height = 1;
  }

  toScreen(x, y) {
    const [c, s] = [Math.cos(this.turn), Math.sin(this.turn)];
    const [dx, dy] = [x - this.x, y - this.y];
    return [this.width / 2 + this.scale * (c * dx - s * dy), this.height / 2 - this.scale * (s * dx + c * dy)];
  }

  toWorld(px, py) {
    const [c, s] = [Math.cos(this.turn), Math.sin(this.turn)];
    const [a, b] = [(px - this.width / 2) / this.scale, (this.height / 2 - py) / this.scale];
    return [this.x + c * a + s * b, this.y - s * a + c * b];
  }

  /** The same place stays under the pixel. */
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.toWorld(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, FARTHEST), NEAREST);
    const [nx, ny] = this.toWorld(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  pan(dx, dy) {
    const [x, y] = this.toWorld(this.width / 2 - dx, this.height / 2 - dy);
    this.x = x;
    this.y = y;
  }

  /** x0, y0, x1, y1 in m that hold all that can be seen. */
  visible() {
    const corners = [[0, 0], [this.width, 0], [0, this.height], [this.width, this.height]].map(([a, b]) => this.toWorld(a, b));
    const [xs, ys] = [corners.map(([x]) => x), corners.map(([, y]) => y)];
    return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
  }

  fit([x0, y0, x1, y1]) {
    this.turn = 0;
    this.x = (x0 + x1) / 2;
    this.y = (y0 + y1) / 2;
    this.scale = Math.min(Math.max(0.92 * Math.min(this.width / (x1 - x0), this.height / (y1 - y0)), FARTHEST), NEAREST);
  }

  /** For a context to draw in metres, y up. */
  apply(context, ratio) {
    const [c, s] = [Math.cos(this.turn) * this.scale * ratio, Math.sin(this.turn) * this.scale * ratio];
    const [px, py] = this.toScreen(0, 0);
    context.setTransform(c, -s, -s, -c, px * ratio, py * ratio);
  }

  /** The longest of 1, 2, 5 … m that is at most so many pixels long. */
  rule(pixels) {
    const most = pixels / this.scale;
    const ten = 10 ** Math.floor(Math.log10(most));
    return [5, 2, 1].map((n) => n * ten).find((length) => length <= most) ?? ten;
  }
}
