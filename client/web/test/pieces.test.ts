import { expect, test } from "vitest";
import { splitPieces } from "../src/pieces";

const faces = (skin: number[], cut: number[] = [], seam: number[] = [], materials: number[] = []) =>
  splitPieces({ skin: Uint32Array.from(skin), cut: Uint32Array.from(cut), seam: Uint32Array.from(seam), materials });

test("triangles that share no vertex are pieces, the largest first", () => {
  const small = [10, 11, 12];
  const large = [0, 1, 2, 3, 4, 5, 2, 1, 3];
  const pieces = faces([...small, ...large]);
  expect(pieces.map(({ parts }) => parts.map(({ triangles }) => triangles))).toEqual([[large], [small]]);
  expect(faces([])).toEqual([]);
});

test("a piece has a part for each material of its skin and of its cut, and its own edges of the seam", () => {
  const materials = [0, 0, 1, 1, 1, 0, 0, 0];
  const pieces = faces([0, 1, 2, 1, 2, 3, 5, 6, 7], [2, 3, 4], [2, 3], materials);
  expect(pieces).toEqual([
    {
      parts: [
        { face: "skin", material: 0, triangles: [0, 1, 2] },
        { face: "skin", material: 1, triangles: [1, 2, 3] },
        { face: "cut", material: 1, triangles: [2, 3, 4] },
      ],
      seam: [2, 3],
    },
    { parts: [{ face: "skin", material: 0, triangles: [5, 6, 7] }], seam: [] },
  ]);
});
