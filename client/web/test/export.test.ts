import { Color } from "three";
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
  scenes: { nodes: number[] }[];
  nodes: { name: string; mesh?: number; children?: number[] }[];
  meshes: { name: string; primitives: { attributes: Record<string, number>; indices?: number; mode?: number; material: number }[] }[];
  materials: { name: string; pbrMetallicRoughness: { baseColorFactor: number[] } }[];
  accessors: { count: number; componentType: number; normalized?: boolean; type: string; bufferView: number; byteOffset?: number }[];
  bufferViews: { byteOffset?: number }[];
}

/** A file's document and its binary part. */
async function read(tissues: Exported[]): Promise<[Gltf, Buffer]> {
  const file = Buffer.from(await (await glb(tissues)).arrayBuffer());
  expect(file.subarray(0, 4).toString()).toBe("glTF");
  const length = file.readUInt32LE(12);
  return [JSON.parse(file.subarray(20, 20 + length).toString()) as Gltf, file.subarray(28 + length)];
}

/** What is seen at the vertices of each primitive, linear: the material's colour by the vertices', of 16 bits. */
function seen({ meshes, materials, accessors, bufferViews }: Gltf, binary: Buffer, mesh: number): number[][][] {
  return meshes[mesh].primitives.map(({ attributes, material }) => {
    const { count, componentType, normalized, type, bufferView, byteOffset } = accessors[attributes["COLOR_0"]];
    expect([componentType, normalized, type]).toEqual([5123, true, "VEC4"]);
    const at = (bufferViews[bufferView].byteOffset ?? 0) + (byteOffset ?? 0);
    const base = materials[material].pbrMetallicRoughness.baseColorFactor;
    return Array.from({ length: count }, (_, vertex) =>
      [0, 1, 2].map((i) => (base[i] * binary.readUInt16LE(at + 8 * vertex + 2 * i)) / 65535),
    );
  });
}

/** The vertices of each primitive's triangles. */
function triangles({ meshes, accessors, bufferViews }: Gltf, binary: Buffer, mesh: number): number[][][] {
  return meshes[mesh].primitives.map(({ indices }) => {
    const { count, componentType, bufferView, byteOffset } = accessors[indices!];
    expect(componentType).toBe(5123);
    const at = (bufferViews[bufferView].byteOffset ?? 0) + (byteOffset ?? 0);
    const vertex = (i: number) => binary.readUInt16LE(at + 2 * i);
    return Array.from({ length: count / 3 }, (_, i) => [vertex(3 * i), vertex(3 * i + 1), vertex(3 * i + 2)]);
  });
}

/** Edges that no other triangle passes the other way. A closed body has none. */
function openEdges(ofBody: number[][]): string[] {
  const edges = new Set(ofBody.flatMap(([a, b, c]) => [`${a} ${b}`, `${b} ${c}`, `${c} ${a}`]));
  expect(edges.size).toBe(3 * ofBody.length);
  return [...edges].filter((edge) => !edges.has(edge.split(" ").reverse().join(" ")));
}

function expectNear(color: number[], expected: number[]): void {
  color.forEach((channel, i) => expect(channel).toBeCloseTo(expected[i], 4));
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

test("a piece is one mesh whose regions have the same vertices, with the seam in a node below it", async () => {
  const [file, binary] = await read([CUT]);
  const { scenes, nodes, meshes, materials, accessors } = file;
  const [piece] = scenes[0].nodes.map((node) => nodes[node]);
  expect([piece.name, meshes[piece.mesh!].name]).toEqual(["liver", "liver"]);
  const [seam] = piece.children!.map((child) => nodes[child]);
  const { primitives } = meshes[piece.mesh!];
  expect(primitives.map(({ material }) => materials[material].name)).toEqual(["liver", "tumour"]);
  const ofRegions = triangles(file, binary, piece.mesh!);
  expect(ofRegions.map(({ length }) => length)).toEqual([2, 2]);
  expect(openEdges(ofRegions.flat())).toEqual([]);
  expect(new Set(primitives.map(({ attributes }) => attributes["POSITION"])).size).toBe(1);
  expect(new Set(primitives.map(({ attributes }) => attributes["COLOR_0"])).size).toBe(2);
  expect(accessors[primitives[0].attributes["POSITION"]].count).toBe(4);
  expect(seam.name).toBe("liver seam");
  const [lines] = meshes[seam.mesh!].primitives;
  expect([lines.mode, lines.indices, materials[lines.material].name]).toEqual([1, undefined, "seam"]);
  expect(accessors[lines.attributes["POSITION"]].count).toBe(6);
});

test("pieces of one region are closed primitives", async () => {
  const { skin, cut, seam } = CUT.parts;
  const twice = (vertices: Uint32Array) => Uint32Array.from([...vertices, ...vertices.map((vertex) => vertex + 4)]);
  const parts = { skin: twice(skin), cut: twice(cut), seam: twice(seam), materials: new Uint8Array(8) };
  const severed = { ...CUT, parts, positions: Float32Array.from([...CUT.positions, ...CUT.positions]) };
  const [file, binary] = await read([severed]);
  const pieces = file.scenes[0].nodes.map((node) => file.nodes[node]);
  expect(pieces.map(({ name }) => name)).toEqual(["liver 1", "liver 2"]);
  for (const { mesh } of pieces) {
    const [body, ...others] = triangles(file, binary, mesh!);
    expect([openEdges(body), others]).toEqual([[], []]);
  }
});

test("skin, cut and seam differ in the colours of their vertices", async () => {
  const colors = async (look: Exported["looks"][number]) => {
    // Two triangles that share no more than the seam.
    const parts = {
      skin: Uint32Array.of(0, 1, 2),
      cut: Uint32Array.of(2, 1, 3),
      seam: Uint32Array.of(1, 2),
      materials: new Uint8Array(4),
    };
    const [file, binary] = await read([{ ...CUT, parts, looks: [look], materialNames: ["part"] }]);
    const [of] = seen(file, binary, file.nodes[file.scenes[0].nodes[0]].mesh!);
    return [of, file.materials[0].pbrMetallicRoughness.baseColorFactor] as const;
  };
  const linear = (srgb: number) => new Color(srgb).toArray();
  const stated = lookOf("part", 0, "#ff0080");
  const [of, base] = await colors(stated);
  expectNear(of[0], linear(0xff0080));
  expectNear(of[3], linear(stated.cut));
  for (const rim of [of[1], of[2]]) expectNear(rim, base.map((channel) => 0.08 * channel));
  expectNear(base, [...linear(stated.cut), 1]);
  // Of a vein the cut is darker than the skin.
  const vein = lookOf("vein", 0);
  const [ofVein] = await colors(vein);
  expectNear(ofVein[0], linear(vein.skin));
  expectNear(ofVein[3], linear(vein.cut));
});
