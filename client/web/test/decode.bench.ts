// What a state of 20,000 vertices and 1,000 elements costs the viewer's worker: to be at most 2 ms. What is left
// to the page is to hand three arrays to the graphics card.

import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import { bench } from "vitest";
import { Replica } from "../src/decode/replica";
import { BodySurface } from "../src/decode/surface";
import { ViewResponseSchema } from "../src/gen/kerf/v1/view_pb";
import { keyframe, slab, state } from "./messages";

const structure = slab(28, 5);
const frame = keyframe([structure]);
const displacements = structure.nodeRestM.map((x) => 0.01 * Math.sin(100 * x));
const message = { case: "state" as const, value: state(displacements) };
const bytes = toBinary(ViewResponseSchema, create(ViewResponseSchema, { message }));
const replica = new Replica();
replica.applyKeyframe(frame);
const surface = new BodySurface(replica.bodies[0]);
surface.restructure();
let shape = surface.shape();

bench(`a state of ${structure.vertexIds.length} vertices, from bytes to arrays for the graphics card`, () => {
  const event = fromBinary(ViewResponseSchema, bytes);
  if (event.message.case === "state") replica.applyState(event.message.value);
  shape = surface.shape(shape);
});

bench("its keyframe, with the hash of the surface", () => {
  new Replica().applyKeyframe(frame);
});

bench("triangles after a patch", () => {
  surface.restructure();
});
