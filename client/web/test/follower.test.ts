import { expect, test } from "vitest";
import { Follower } from "../src/net/follower";

const still = { position: [0, 0, 0], orientation: [0, 0, 0, 1], opening: 1 } as const;
const SIZE_M = 0.2;
const TICK_S = 0.008;

test("a tool follows a pointer that jumps no faster than a hand, and arrives", () => {
  const follower = new Follower(SIZE_M, still);
  follower.goal = { position: [0.1, 0, 0], orientation: [0, Math.SQRT1_2, 0, Math.SQRT1_2], opening: 0 };
  let before = 0;
  let ticks = 0;
  for (; follower.follow(TICK_S) && ticks < 1000; ticks++) {
    const [x] = follower.pose.position;
    // A size of the scene a second.
    expect(x - before).toBeLessThanOrEqual(SIZE_M * TICK_S * (1 + 1e-9));
    expect(x).toBeGreaterThanOrEqual(before);
    before = x;
  }
  expect(ticks * TICK_S).toBeGreaterThan(0.5);
  expect(ticks).toBeLessThan(1000);
  expect(before).toBeCloseTo(0.1, 6);
  expect(follower.pose.orientation[1]).toBeCloseTo(Math.SQRT1_2, 3);
  expect(follower.pose.opening).toBe(0);
});

test("a hand at rest moves nothing", () => {
  expect(new Follower(SIZE_M, still).follow(TICK_S)).toBe(false);
});
