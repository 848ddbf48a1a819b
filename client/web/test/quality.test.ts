import { expect, test } from "vitest";
import { Quality } from "../src/scene/quality";

test("a machine that draws slowly draws less, and what stands still is drawn finely, once", () => {
  const quality = new Quality();
  let now = 0;
  const fineness = () => quality.moving((now += 100));
  for (let picture = 0; picture < 7; picture++) fineness();
  expect(fineness()).toBeLessThan(1);
  for (let picture = 0; picture < 40; picture++) fineness();
  expect(fineness()).toBeLessThan(0.5);
  expect(quality.standsStill(now + 100)).toBe(false);
  expect(quality.standsStill(now + 1000)).toBe(true);
  expect(quality.standsStill(now + 2000)).toBe(false);
});

test("a machine that is far too slow draws coarsely within a few pictures", () => {
  const quality = new Quality();
  const finenesses = [1, 2, 3, 4, 5].map((picture) => quality.moving(320 * picture));
  expect(finenesses).toEqual([1, 0.75, 0.5, 0.35, 0.35]);
});

test("a machine that draws in time draws all there is, however long things stood still", () => {
  const quality = new Quality();
  let now = 0;
  for (let picture = 0; picture < 100; picture++) quality.moving((now += picture % 10 === 0 ? 1000 : 16));
  expect(quality.moving(now + 16)).toBe(1);
  expect(quality.standsStill(now + 1000)).toBe(false);
});
