// Run by test_page_logic.py: decodes frames from stdin (length-prefixed) and prints what it made of them.
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const page = process.argv[2];
const { decode } = await import(pathToFileURL(`${page}/wire.js`));
const { CellMap, shade, TILE } = await import(pathToFileURL(`${page}/map.js`));
const { Sight } = await import(pathToFileURL(`${page}/sight.js`));

const input = readFileSync(0);
const frames = [];
for (let at = 0; at < input.length; ) {
  const length = input.readUInt32LE(at);
  frames.push(decode(Uint8Array.from(input.subarray(at + 4, at + 4 + length)).buffer));
  at += 4 + length;
}
const map = new CellMap();
for (const frame of frames) if (frame.blocks) map.put(frame.plane, frame.blocks);
const plain = (value) => (ArrayBuffer.isView(value) ? Array.from(value) : value);
const told = frames.filter(({ blocks }) => !blocks).map((frame) => Object.fromEntries(Object.entries(frame).map(([key, value]) => [key, plain(value)])));

const looks = [];
for (const [x, y, turn, scale, px, py] of [[3, -7, 0, 12, 100, 20], [100, 50, 2.1, 0.5, 3, 400], [-5, 0.1, -1.3, 60, 640, 360]]) {
  const sight = Object.assign(new Sight(), { x, y, turn, scale, width: 800, height: 600 });
  const world = sight.toWorld(px, py);
  const back = sight.toScreen(...world);
  sight.zoom(1.7, px, py);
  const stays = sight.toWorld(px, py);
  const matrix = { setTransform: (...m) => (matrix.m = m) };
  sight.apply(matrix, 2);
  const [a, b, c, d, e, f] = matrix.m;
  const [wx, wy] = stays;
  looks.push({ px, py, back, world, stays, drawn: [a * wx + c * wy + e, b * wx + d * wy + f].map((v) => v / 2) });
}

const pixels = new Uint8ClampedArray(TILE * TILE * 4);
const planes = { 0: new Int8Array(TILE * TILE).fill(-1), 2: new Uint32Array(TILE * TILE) };
planes[0].set([0, 100, 50, -1, 100]);
planes[2].set([10, 10, 10, 10, 99]);
shade(pixels, planes, { mode: "probability", theme: "light", now: 0, old: 60, until: 50 });

const asked = JSON.parse(process.argv[3]).map(([x, y]) => map.cellAt(x, y, 0.25));
console.log(JSON.stringify({ told, counts: map.counts(), seen: map.seen, bounds: map.bounds(0.25), asked, looks, pixels: Array.from(pixels.subarray(0, 20)) }));
