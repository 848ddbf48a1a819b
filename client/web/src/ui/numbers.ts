// Numbers as people read them: three digits, and a unit that fits.

const PREFIXES: readonly (readonly [number, string])[] = [
  [1e9, "G"],
  [1e6, "M"],
  [1e3, "k"],
  [1, ""],
  [1e-3, "m"],
  [1e-6, "µ"],
];

export function digits(value: number): string {
  if (value === 0) return "0";
  const size = Math.abs(value);
  const places = size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
  return value.toFixed(places);
}

/** `0.00123, "J"` as `1.23 mJ`. */
export function withUnit(value: number, unit: string): string {
  const size = Math.abs(value);
  const found = PREFIXES.find(([least]) => size >= least);
  // What is smaller than any prefix is rounding.
  return found ? `${digits(value / found[0])} ${found[1]}${unit}` : `0 ${unit}`;
}

export function milliseconds(seconds: number): string {
  return `${digits(1000 * seconds)} ms`;
}
