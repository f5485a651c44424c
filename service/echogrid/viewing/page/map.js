// The cells of the map, in tiles that are pictures: drawn anew only where cells have changed or are shown otherwise.
import { PLANE, SIDE } from "./wire.js";

export const TILE = 128; // cells along a tile's side
const PER = TILE / SIDE; // blocks along it
const MOST_TILES = 1200; // that are kept; the least recently changed one goes
export const MODES = ["probability", "source", "age", "truth"];

/** Colours of both themes, as [r, g, b]. */
export const COLOURS = {
  light: { unknown: null, free: [255, 255, 255], occupied: [17, 20, 26], learned: [94, 60, 190], newest: [0, 104, 150], oldest: [205, 190, 150] },
  dark: { unknown: null, free: [52, 59, 70], occupied: [244, 246, 250], learned: [186, 160, 255], newest: [90, 200, 250], oldest: [96, 82, 52] },
};

export class CellMap {
  constructor() {
    this.tiles = new Map(); // "row,column" of tiles -> tile
    this.mode = "probability";
    this.theme = "light";
    this.now = 0; // Unix s, for ages
    this.old = 60; // s after which a cell is as old as can be shown
    this.until = Infinity; // Unix s: cells last seen later are hidden
    this.seen = [Infinity, 0]; // oldest and newest second that a cell was seen, of what came
  }

  clear() {
    for (const [key, tile] of this.tiles) {
      tile.planes = { [PLANE.TRUTH]: tile.planes[PLANE.TRUTH] };
      tile.stale = true;
      if (!tile.planes[PLANE.TRUTH]) this.tiles.delete(key);
    }
    this.seen = [Infinity, 0];
  }

  /** Takes the blocks of a frame. */
  put(plane, blocks) {
    for (const { row, column, cells } of blocks) {
      const [tileRow, tileColumn] = [Math.floor(row / PER), Math.floor(column / PER)];
      const tile = this.tile(tileRow, tileColumn);
      const held = (tile.planes[plane] ??= new cells.constructor(TILE * TILE).fill(plane === PLANE.OCCUPANCY || plane === PLANE.TRUTH ? -1 : 0));
      const [top, left] = [(row - tileRow * PER) * SIDE, (column - tileColumn * PER) * SIDE];
      for (let i = 0; i < SIDE; i++) held.set(cells.subarray(i * SIDE, (i + 1) * SIDE), (top + i) * TILE + left);
      if (plane === PLANE.SEEN) {
        for (const second of cells) {
          if (second && second < this.seen[0]) this.seen[0] = second;
          if (second > this.seen[1]) this.seen[1] = second;
        }
      }
      tile.stale = true;
    }
  }

  tile(row, column) {
    const key = `${row},${column}`;
    let tile = this.tiles.get(key);
    if (tile) this.tiles.delete(key);
    else tile = { row, column, planes: {}, stale: true, picture: null };
    this.tiles.set(key, tile);
    if (this.tiles.size > MOST_TILES) this.tiles.delete(this.tiles.keys().next().value);
    return tile;
  }

  /** Shows all cells otherwise. */
  show(settings) {
    Object.assign(this, settings);
    for (const tile of this.tiles.values()) tile.stale = true;
  }

  /** Percent of the cell at x, y (m), -1 where never seen; and its source and age, where they are known. */
  cellAt(x, y, cell) {
    const [row, column] = [Math.floor(y / cell), Math.floor(x / cell)];
    const tile = this.tiles.get(`${Math.floor(row / TILE)},${Math.floor(column / TILE)}`);
    if (!tile) return { percent: -1 };
    const at = mod(row, TILE) * TILE + mod(column, TILE);
    const of = (plane, none) => (tile.planes[plane] ? tile.planes[plane][at] : none);
    return { percent: of(PLANE.OCCUPANCY, -1), source: of(PLANE.SOURCE, 0), seen: of(PLANE.SEEN, 0), truth: of(PLANE.TRUTH, -1) };
  }

  counts() {
    let known = 0;
    let occupied = 0;
    for (const { planes } of this.tiles.values()) {
      for (const percent of planes[PLANE.OCCUPANCY] ?? []) {
        if (percent >= 0) known++;
        if (percent >= 50) occupied++;
      }
    }
    return { known, occupied };
  }

  /** x0, y0, x1, y1 in m of all tiles of the map, or of the truth while that is shown; null for an empty one. */
  bounds(cell) {
    let box = null;
    const plane = this.mode === "truth" ? PLANE.TRUTH : PLANE.OCCUPANCY;
    for (const { row, column, planes } of this.tiles.values()) {
      if (!planes[plane]) continue;
      const [x, y, side] = [column * TILE * cell, row * TILE * cell, TILE * cell];
      box = box ? [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x + side), Math.max(box[3], y + side)] : [x, y, x + side, y + side];
    }
    return box;
  }

  /** On a context whose unit is a metre, y up. */
  draw(context, cell, visible, scale) {
    context.imageSmoothingEnabled = scale * cell < 1; // cells are squares, unless they are smaller than a pixel
    const side = TILE * cell;
    const seam = 0.5 / scale; // m: half a pixel, so that no line shows between tiles
    for (const tile of this.tiles.values()) {
      const [x, y] = [tile.column * side, tile.row * side];
      if (x > visible[2] || x + side < visible[0] || y > visible[3] || y + side < visible[1]) continue;
      if (tile.stale) this.paint(tile);
      context.drawImage(tile.picture, x, y, side + seam, side + seam); // row 0 of the picture is the lowest: the context is mirrored as well
    }
  }

  paint(tile) {
    if (!tile.picture) {
      tile.picture = new OffscreenCanvas(TILE, TILE);
      tile.image = new ImageData(TILE, TILE);
    }
    shade(tile.image.data, tile.planes, this);
    tile.picture.getContext("2d").putImageData(tile.image, 0, 0);
    tile.stale = false;
  }
}

/** RGBA of the cells of a tile: pure, so that it can be tested by itself. */
export function shade(pixels, planes, { mode, theme, now, old, until }) {
  const colours = COLOURS[theme];
  const percents = mode === "truth" ? planes[PLANE.TRUTH] : planes[PLANE.OCCUPANCY];
  const [sources, seen] = [planes[PLANE.SOURCE], planes[PLANE.SEEN]];
  for (let n = 0, at = 0; n < TILE * TILE; n++, at += 4) {
    const percent = percents ? percents[n] : -1;
    if (percent < 0 || (seen && mode !== "truth" && seen[n] > until)) {
      pixels[at + 3] = 0;
      continue;
    }
    const p = percent / 100;
    for (let c = 0; c < 3; c++) {
      let value = colours.free[c] + (colours.occupied[c] - colours.free[c]) * p;
      if (mode === "source" && sources && sources[n] === 1) value += (colours.learned[c] - value) * 0.55;
      if (mode === "age" && seen) {
        const age = seen[n] ? Math.min(Math.max((now - seen[n]) / old, 0), 1) : 1;
        const hue = colours.newest[c] + (colours.oldest[c] - colours.newest[c]) * age;
        value = hue + (value - hue) * 0.45;
      }
      pixels[at + c] = value;
    }
    pixels[at + 3] = 255;
  }
}

function mod(a, n) {
  return ((a % n) + n) % n;
}
