import { expect, test } from "vitest";
import { splitPieces } from "../src/pieces";

test("triangles that share no vertex are pieces, the largest first", () => {
  const small = [10, 11, 12];
  const large = [0, 1, 2, 3, 4, 5, 2, 1, 3];
  const pieces = splitPieces(Uint32Array.from([...small, ...large]));
  expect(pieces.map((piece) => [...piece])).toEqual([large, small]);
  expect(splitPieces(new Uint32Array(0))).toEqual([]);
});
