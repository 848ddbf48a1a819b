// The recorded stream of proto/vectors, by which decoders in every language are checked.

import { readFileSync } from "node:fs";
import { fromBinary } from "@bufbuild/protobuf";
import { expect, test } from "vitest";
import { Assembler } from "../src/decode/assembler";
import { Replica } from "../src/decode/replica";
import { BodySurface } from "../src/decode/surface";
import { type ViewResponse, ViewResponseSchema } from "../src/gen/kerf/v1/view_pb";

interface Expected {
  message: string;
  topology_version: number | null;
  counts: [number, number];
  shown?: { object: number; id: number; position_m: [number, number, number] }[];
}

function read(name: string): Buffer {
  return readFileSync(new URL(`../../../proto/vectors/${name}`, import.meta.url));
}

function messages(name: string): ViewResponse[] {
  const file = read(name);
  const assembler = new Assembler();
  const wholes: ViewResponse[] = [];
  for (let at = 0; at < file.length; ) {
    const from = at + 4;
    at = from + file.readUInt32LE(at);
    const whole = assembler.take(fromBinary(ViewResponseSchema, file.subarray(from, at)));
    if (whole) wholes.push(whole);
  }
  return wholes;
}

test.each(["cut", "cut-vertices"])("%s, recorded, is decoded as the Rust replica decodes it", (name) => {
  const expected = JSON.parse(read(`${name}.json`).toString()) as Expected[];
  const wholes = messages(`${name}.bin`);
  expect(wholes.map(({ message }) => message.case)).toEqual(expected.map(({ message }) => message));
  const replica = new Replica();
  let surfaces: BodySurface[] = [];
  let worst = 0;
  wholes.forEach(({ message }, index) => {
    if (message.case === "keyframe") {
      replica.applyKeyframe(message.value);
      surfaces = replica.bodies.map((body) => new BodySurface(body));
    }
    // Each compares its hash with the server's.
    if (message.case === "patch") replica.applyPatch(message.value);
    if (message.case === "keyframe" || message.case === "patch") surfaces.forEach((surface) => surface.restructure());
    if (message.case === "state") replica.applyState(message.value);
    const { counts, shown } = expected[index];
    const sum = (of: (body: (typeof replica.bodies)[number]) => number) =>
      replica.bodies.reduce((total, body) => total + of(body), 0);
    expect([sum((body) => body.vertexCount), sum((body) => body.quadCount)]).toEqual(counts);
    if (!shown) return;
    const shapes = surfaces.map((surface) => surface.shape());
    for (const { object, id, position_m } of shown) {
      const slot = replica.bodies[object].vertexSlot(id)!;
      position_m.forEach((at, axis) => {
        worst = Math.max(worst, Math.abs(shapes[object].positions[3 * slot + axis] - at));
      });
    }
  });
  expect(worst).toBeLessThan(1e-7);
  // The stream ends with a cut: its seam is lines that go on, along edges that only one wall has.
  const { seam } = surfaces[0].restructure();
  const ends = new Map<number, number>();
  for (const vertex of seam) ends.set(vertex, (ends.get(vertex) ?? 0) + 1);
  expect(ends.size).toBeGreaterThan(8);
  expect([...ends.values()].every((count) => count % 2 === 0)).toBe(true);
});
