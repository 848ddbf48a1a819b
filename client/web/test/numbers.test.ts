import { expect, test } from "vitest";
import { digits, withUnit } from "../src/ui/numbers";

test("numbers have three digits and a unit that fits", () => {
  expect([1234.5, 12.345, 1.2345, 0.12345, 0].map(digits)).toEqual(["1235", "12.3", "1.23", "0.123", "0"]);
  expect([1.5e-3, -2e3, 0, 1e-12].map((value) => withUnit(value, "J"))).toEqual(["1.50 mJ", "-2.00 kJ", "0 J", "0 J"]);
});
