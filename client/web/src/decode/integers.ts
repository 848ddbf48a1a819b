// Integers in `bytes` fields, as kerf/v1/view.proto says: zigzag and LEB128, zeros counted.

import { FieldError } from "./check";

/** Reads what a field holds, a group of numbers after another. */
class Reader {
  private readonly field: string;
  private readonly bytes: Uint8Array;
  private at = 0;

  constructor(field: string, bytes: Uint8Array) {
    this.field = field;
    this.bytes = bytes;
  }

  get isAtEnd(): boolean {
    return this.at === this.bytes.length;
  }

  /** The next number before it is zigzagged back, below 2^53. */
  next(): number {
    const { bytes } = this;
    let value = 0;
    for (let scale = 1; scale < 2 ** 53 && this.at < bytes.length; scale *= 128) {
      const byte = bytes[this.at++];
      value += (byte & 0x7f) * scale;
      if (byte < 0x80) {
        if (value > Number.MAX_SAFE_INTEGER) break;
        return value;
      }
    }
    throw new FieldError(this.field, "no integers as the protocol writes them");
  }
}

/** Reads at most `out.length` integers into `out`; answers with how many there were. */
export function decodeIntegers(field: string, bytes: Uint8Array, out: Int32Array | Float64Array): number {
  const reader = new Reader(field, bytes);
  let count = 0;
  while (!reader.isAtEnd) {
    const value = reader.next();
    const repeats = value === 0 ? reader.next() + 1 : 1;
    if (count + repeats > out.length) throw new FieldError(field, `more than ${out.length} entries`);
    if (value === 0) {
      out.fill(0, count, count + repeats);
      count += repeats;
    } else {
      out[count++] = value % 2 === 0 ? value / 2 : -(value + 1) / 2;
    }
  }
  return count;
}

/** Reads exactly as many integers as `out` has room for. */
export function decodeExactly(field: string, bytes: Uint8Array, out: Int32Array | Float64Array): void {
  const count = decodeIntegers(field, bytes, out);
  if (count !== out.length) throw new FieldError(field, `${count} entries, ${out.length} expected`);
}
