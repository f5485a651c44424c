// What the server says, as objects: the other half of viewing/wire.py. No DOM here, so that it can be tested by itself.
export const KIND = { HELLO: 1, RESET: 2, BLOCKS: 3, POSE: 4, POINTS: 5, STATUS: 6, TRAIL: 7, CLOCK: 8 };
export const PLANE = { OCCUPANCY: 0, SOURCE: 1, SEEN: 2, TRUTH: 3 };
export const SIDE = 32; // cells along a block's side
const ARRAYS = [Int8Array, Uint8Array, Uint32Array, Int8Array]; // by plane
const JSON_KINDS = new Set([KIND.HELLO, KIND.STATUS, KIND.CLOCK]);

/** One frame (ArrayBuffer). Throws RangeError where it is shorter than it says. */
export function decode(buffer) {
  const view = new DataView(buffer);
  const kind = view.getUint8(0);
  if (JSON_KINDS.has(kind)) return { kind, ...JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4))) };
  if (kind === KIND.RESET) return { kind };
  if (kind === KIND.BLOCKS) return blocks(buffer, view);
  if (kind === KIND.POSE) {
    const [x, y, yaw, speed, yawRate] = [16, 24, 32, 40, 48].map((at) => view.getFloat64(at, true));
    return { kind, stamp: seconds(view, 8), x, y, yaw, speed, yawRate };
  }
  if (kind === KIND.POINTS) {
    const count = view.getUint32(4, true);
    const at = 16 + 8 * count;
    return {
      kind,
      stamp: seconds(view, 8),
      places: new Float32Array(buffer, 16, 2 * count), // x, y of each, m in odom
      radars: new Uint8Array(buffer, at, count),
      verdicts: new Uint8Array(buffer, at + count, count),
    };
  }
  if (kind === KIND.TRAIL) {
    return { kind, true: view.getUint8(1) === 1, places: new Float32Array(buffer, 8, 2 * view.getUint32(4, true)) };
  }
  throw new RangeError(`a frame of the unknown kind ${kind}`);
}

function blocks(buffer, view) {
  const plane = view.getUint8(1);
  const count = view.getUint16(2, true);
  const keys = new Int32Array(buffer, 4, 2 * count);
  const cells = new ARRAYS[plane](buffer, 4 + 8 * count, count * SIDE * SIDE);
  const found = [];
  for (let n = 0; n < count; n++) {
    found.push({ row: keys[2 * n], column: keys[2 * n + 1], cells: cells.subarray(n * SIDE * SIDE, (n + 1) * SIDE * SIDE) });
  }
  return { kind: KIND.BLOCKS, plane, blocks: found };
}

/** Of a stamp in ns since 1970; to the microsecond, which is all that a double holds of it. */
function seconds(view, at) {
  return Number(view.getBigInt64(at, true) / 1000n) / 1e6;
}
