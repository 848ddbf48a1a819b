// The surface hash of kerf/v1/view.proto. 64-bit words are pairs of 32-bit halves: a keyframe takes a hundred
// thousand of these steps, which big integers would make the slowest part of the decoder.

/** A 64-bit word or sum; halves as unsigned 32-bit numbers. */
export interface Word {
  hi: number;
  lo: number;
}

/** High 32 bits of the product of two unsigned 32-bit numbers. */
function productHigh(a: number, b: number): number {
  const a0 = a & 0xffff;
  const a1 = a >>> 16;
  const b0 = b & 0xffff;
  const b1 = b >>> 16;
  const middle = a1 * b0 + ((a0 * b0) >>> 16);
  const carried = a0 * b1 + (middle & 0xffff);
  return (a1 * b1 + (middle >>> 16) + (carried >>> 16)) | 0;
}

/** hash = mix(hash xor word). */
function fold(hash: Word, wordHi: number, wordLo: number): void {
  let lo = (hash.lo ^ wordLo) >>> 0;
  let hi = hash.hi ^ wordHi;
  const sum = lo + 0x7f4a7c15;
  hi = (hi + 0x9e3779b9 + (sum > 0xffffffff ? 1 : 0)) | 0;
  lo = sum | 0;
  lo ^= (lo >>> 30) | (hi << 2);
  hi ^= hi >>> 30;
  hi = (productHigh(lo >>> 0, 0x1ce4e5b9) + Math.imul(hi, 0x1ce4e5b9) + Math.imul(lo, 0xbf58476d)) | 0;
  lo = Math.imul(lo, 0x1ce4e5b9);
  lo ^= (lo >>> 27) | (hi << 5);
  hi ^= hi >>> 27;
  hi = (productHigh(lo >>> 0, 0x133111eb) + Math.imul(hi, 0x133111eb) + Math.imul(lo, 0x94d049bb)) | 0;
  lo = Math.imul(lo, 0x133111eb);
  lo ^= (lo >>> 31) | (hi << 1);
  hi ^= hi >>> 31;
  hash.hi = hi >>> 0;
  hash.lo = lo >>> 0;
}

/** In the place where a vertex has its material, which is below both. */
const QUAD = 1 << 16;
const HELD = 1 << 17;

/** Hash of a vertex: its id, its element's id, its material and the bit patterns of its local coordinates. */
export function vertexHash(id: number, element: number, material: number, u: number, v: number, w: number): Word {
  const hash = { hi: 0, lo: 0 };
  fold(hash, id, element);
  fold(hash, u, v);
  fold(hash, material, w);
  return hash;
}

/** Hash of a quad: its id and those of its corners. */
export function quadHash(id: number, a: number, b: number, c: number, d: number): Word {
  const hash = { hi: 0, lo: 0 };
  fold(hash, id, a);
  fold(hash, b, c);
  fold(hash, QUAD, d);
  return hash;
}

/** Hash of the weights of a vertex beside what is held: its id and their bit patterns. */
export function heldHash(id: number, weights: readonly number[]): Word {
  const bits = new Uint32Array(Float32Array.from(weights).buffer);
  const hash = { hi: 0, lo: 0 };
  fold(hash, id, bits[0]);
  for (let i = 1; i < 7; i += 2) fold(hash, bits[i], bits[i + 1]);
  fold(hash, HELD, bits[7]);
  return hash;
}

/** Hash of the surface, of the sums over each object's items. */
export function surfaceHash(sums: Iterable<Word>): bigint {
  const hash = { hi: 0, lo: 0 };
  for (const sum of sums) fold(hash, sum.hi, sum.lo);
  return (BigInt(hash.hi) << 32n) | BigInt(hash.lo);
}

/** sum += word */
export function add(sum: Word, hi: number, lo: number): void {
  const low = sum.lo + lo;
  sum.lo = low >>> 0;
  sum.hi = (sum.hi + hi + (low > 0xffffffff ? 1 : 0)) >>> 0;
}

/** sum -= word */
export function subtract(sum: Word, hi: number, lo: number): void {
  const low = sum.lo - lo;
  sum.lo = low >>> 0;
  sum.hi = (sum.hi - hi - (low < 0 ? 1 : 0)) >>> 0;
}
