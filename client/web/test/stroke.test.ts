import { expect, test } from "vitest";
import type { Sample } from "../src/net/frames";
import { Stroke } from "../src/stroke";

/** A blade that cuts down, at a height. */
function sample(simTimeS: number, heightM: number, forceN: number): Sample {
  const pose = { position: [0, heightM, 0] as const, orientation: [0, 0, 0, 1] as const };
  const tool = { pose, forceN: [0, forceN, 0] as const, cuttingLengthM: 0, opening: 1, isHolding: false };
  return { simTimeS, tools: [tool] };
}

test("depth counts from the first touch, along the cutting direction, until the tool is out again", () => {
  const stroke = new Stroke();
  const way = [sample(0, 0.05, 0), sample(1, 0.04, 0.1), sample(2, 0.03, 2), sample(3, 0.06, 0), sample(4, 0.03, 1)];
  const points = stroke.points(way, 0);
  expect(points.map(({ depthM }) => Number(depthM.toFixed(6)))).toEqual([0, 0, 0.01, 0, 0]);
  expect(points.map(({ forceN }) => forceN)).toEqual([0, 0.1, 2, 0, 1]);
});

test("of jaws that hold tissue it is how far they have pulled it", () => {
  const stroke = new Stroke();
  const way = [sample(0, 0.05, 0), sample(1, 0.05, 1), sample(2, 0.08, 3), sample(3, 0.08, 0)];
  way[1].tools[0].isHolding = way[2].tools[0].isHolding = true;
  expect(stroke.points(way, 0).map(({ depthM }) => Number(depthM.toFixed(6)))).toEqual([0, 0, 0.03, 0]);
});
