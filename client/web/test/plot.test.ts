import { expect, test } from "vitest";
import { axisLabels, niceCeiling } from "../src/ui/plot";

test("an axis has few short numbers, and the unit that fits", () => {
  const labels = (value: number, unit: string) => axisLabels(niceCeiling(value), unit);
  expect(labels(4150, "N")).toEqual(["0", "2.5", "5 kN"]);
  expect(labels(130, "N")).toEqual(["0", "100", "200 N"]);
  expect(labels(0.019, "m")).toEqual(["0", "10", "20 mm"]);
  expect(labels(0, "m")).toEqual(["0", "0.5", "1 mm"]);
});
