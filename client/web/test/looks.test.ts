import { expect, test } from "vitest";
import { lookOf } from "../src/scene/looks";

const lightness = (color: number) => (color >> 16) + ((color >> 8) & 255) + (color & 255);

test("a colour that the scene states is the skin's, and its cut faces are paler", () => {
  const stated = lookOf("liver", 0, "#204080");
  expect(stated.skin).toBe(0x204080);
  expect(lightness(stated.cut)).toBeGreaterThan(lightness(stated.skin));
});

test("without one a material is known by its name, and others than the first differ from flesh", () => {
  expect(lookOf("tofu", 0).skin).not.toBe(lookOf("liver", 0).skin);
  expect(lookOf("region", 1).skin).not.toBe(lookOf("liver", 0).skin);
  expect(lookOf("region", 1).skin).not.toBe(lookOf("region", 2).skin);
});
