import { beforeAll, expect, test } from "vitest";
import { type Exported, glb } from "../src/export";
import { lookOf } from "../src/scene/looks";

beforeAll(() => {
  // What three.js asks a browser for, and Node has under another name.
  class Reader {
    result: ArrayBuffer | undefined;
    onloadend = () => {};
    readAsArrayBuffer(blob: Blob) {
      void blob.arrayBuffer().then((result) => {
        this.result = result;
        this.onloadend();
      });
    }
  }
  Object.assign(globalThis, { FileReader: Reader });
});

interface Gltf {
  nodes: { name: string; mesh?: number; children?: number[] }[];
  meshes: { primitives: { attributes: Record<string, number>; indices?: number; mode?: number; material: number }[] }[];
  materials: { name: string; pbrMetallicRoughness: { baseColorFactor: number[] } }[];
  accessors: { count: number }[];
}

/** A tetrahedron whose last face was laid open, and whose first is of a tumour. */
const CUT: Exported = {
  name: "liver",
  materialNames: ["liver", "tumour"],
  looks: [lookOf("liver", 0, "#ff0000"), lookOf("tumour", 1, "#00ff00")],
  positions: Float32Array.of(0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1),
  parts: {
    skin: Uint32Array.of(1, 2, 3, 0, 3, 2, 0, 1, 3),
    cut: Uint32Array.of(0, 2, 1),
    seam: Uint32Array.of(0, 1, 1, 2, 2, 0),
    materials: Uint8Array.of(0, 0, 1, 1),
  },
};

test("a piece is one mesh whose parts have the same vertices, with the seam in a node below it", async () => {
  const file = Buffer.from(await (await glb([CUT])).arrayBuffer());
  expect(file.subarray(0, 4).toString()).toBe("glTF");
  const { nodes, meshes, materials, accessors } = JSON.parse(
    file.subarray(20, 20 + file.readUInt32LE(12)).toString(),
  ) as Gltf;
  const piece = nodes.find(({ name }) => name === "liver")!;
  const [seam] = piece.children!.map((child) => nodes[child]);
  const { primitives } = meshes[piece.mesh!];
  const triangles = Object.fromEntries(
    primitives.map(({ material, indices }) => [materials[material].name, accessors[indices!].count / 3]),
  );
  expect(triangles).toEqual({ liver: 1, tumour: 2, "liver cut": 1 });
  expect(new Set(primitives.map(({ attributes }) => attributes["POSITION"])).size).toBe(1);
  expect(accessors[primitives[0].attributes["POSITION"]].count).toBe(4);
  const ofName = (name: string) => materials.find((material) => material.name === name)!.pbrMetallicRoughness.baseColorFactor;
  expect([ofName("liver"), ofName("tumour")]).toEqual([
    [1, 0, 0, 1],
    [0, 1, 0, 1],
  ]);
  expect(seam.name).toBe("liver seam");
  const [lines] = meshes[seam.mesh!].primitives;
  expect([lines.mode, lines.indices, materials[lines.material].name]).toEqual([1, undefined, "seam"]);
  expect(accessors[lines.attributes["POSITION"]].count).toBe(6);
});
