// Messages made by hand, and a slab with as many vertices as wanted.

import { create } from "@bufbuild/protobuf";
import {
  type BodyStructure,
  BodyStructureSchema,
  type Keyframe,
  KeyframeSchema,
  type State,
  StateSchema,
  type TopologyPatch,
  TopologyPatchSchema,
} from "../src/gen/kerf/v1/view_pb";
import { Body } from "../src/decode/body";
import { surfaceHash } from "../src/decode/hash";

/** Unit of displacements, m. */
export const QUANTUM_M = 2 ** -22;

/** Integers as kerf/v1/view.proto has them. */
export function integers(values: readonly number[]): Uint8Array<ArrayBuffer> {
  const bytes: number[] = [];
  const put = (value: number) => {
    for (; value > 127; value = Math.floor(value / 128)) bytes.push((value % 128) + 128);
    bytes.push(value);
  };
  for (let i = 0; i < values.length; i++) {
    put(values[i] < 0 ? -2 * values[i] - 1 : 2 * values[i]);
    if (values[i] !== 0) continue;
    const first = i;
    while (values[i + 1] === 0) i++;
    put(i - first);
  }
  return Uint8Array.from(bytes);
}

/** Lengths in quanta, as the wire has them. */
export function quanta(lengthsM: readonly number[]): Uint8Array<ArrayBuffer> {
  return integers(lengthsM.map((lengthM) => Math.round(lengthM / QUANTUM_M)));
}

export const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7];

/** Rest positions of the corners of the unit cube. */
export const UNIT_CUBE = CORNERS.flatMap((c) => [c & 1, (c >> 1) & 1, c >> 2]);

/** The unit cube as one element, with the quad of its top face. */
export function cube(): BodyStructure {
  return create(BodyStructureSchema, {
    nodeCount: 8,
    nodeIds: CORNERS,
    nodeRestM: UNIT_CUBE,
    elementIds: [5],
    elementNodes: CORNERS,
    vertexIds: [10, 20, 30, 40],
    vertexElements: [5, 5, 5, 5],
    vertexLocal: [0, 1, 0, 0, 1, 1, 1, 1, 1, 1, 1, 0],
    quadIds: [7],
    quadVertices: [10, 20, 30, 40],
    quantumM: QUANTUM_M,
  });
}

function hashOf(bodies: BodyStructure[]): bigint {
  return surfaceHash(bodies.map((structure) => bodyOf(structure).hashSum));
}

export function bodyOf(structure: BodyStructure): Body {
  const body = new Body();
  body.change(structure);
  return body;
}

export function keyframe(bodies: BodyStructure[], topologyVersion = 3n): Keyframe {
  return create(KeyframeSchema, { topologyVersion, bodies, surfaceHash: hashOf(bodies) });
}

/** A second node slot, element and quad for the cube, whose old quad becomes the other side of a cut. */
export function cutPatch(): TopologyPatch {
  const change = create(BodyStructureSchema, {
    nodeCount: 9,
    nodeIds: [8],
    nodeRestM: [2, 1, 0],
    elementIds: [6],
    elementNodes: [0, 8, 2, 3, 4, 5, 6, 7],
    vertexIds: [50],
    vertexElements: [6],
    vertexLocal: [0, 1, 0],
    quadIds: [6],
    quadVertices: [40, 30, 20, 50],
  });
  const after = create(BodyStructureSchema, {
    nodeCount: 9,
    nodeIds: [...CORNERS, 8],
    nodeRestM: [...UNIT_CUBE, 2, 1, 0],
    elementIds: [5, 6],
    elementNodes: [...CORNERS, 0, 8, 2, 3, 4, 5, 6, 7],
    vertexIds: [10, 20, 30, 40, 50],
    vertexElements: [5, 5, 5, 5, 6],
    vertexLocal: [0, 1, 0, 0, 1, 1, 1, 1, 1, 1, 1, 0, 0, 1, 0],
    quadIds: [6, 7],
    quadVertices: [40, 30, 20, 50, 10, 20, 30, 40],
    quantumM: QUANTUM_M,
  });
  return create(TopologyPatchSchema, {
    fromVersion: 3n,
    toVersion: 5n,
    bodies: [change],
    surfaceHash: hashOf([after]),
  });
}

export function state(displacementsM: number[], topologyVersion = 3n): State {
  const bodies = [{ displacements: quanta(displacementsM) }];
  return create(StateSchema, { topologyVersion, step: 42n, bodies, hasReference: true });
}

/** A square slab of elements with `perElement` x `perElement` quads on the top of each. */
export function slab(elements: number, perElement: number): BodyStructure {
  const nodesAcross = elements + 1;
  const node = (i: number, j: number, top: number) => (j * nodesAcross + i) * 2 + top;
  const nodeRestM: number[] = [];
  const elementNodes: number[] = [];
  const range = (count: number) => Array.from({ length: count }, (_, i) => i);
  for (const j of range(nodesAcross)) {
    for (const i of range(nodesAcross)) nodeRestM.push(0.01 * i, 0, 0.01 * j, 0.01 * i, 0.01, 0.01 * j);
  }
  for (const j of range(elements)) {
    for (const i of range(elements)) {
      for (const c of CORNERS) elementNodes.push(node(i + (c & 1), j + (c >> 2), (c >> 1) & 1));
    }
  }
  const across = elements * perElement;
  const vertexElements: number[] = [];
  const vertexLocal: number[] = [];
  const quadVertices: number[] = [];
  for (const j of range(across + 1)) {
    for (const i of range(across + 1)) {
      const [ei, ej] = [i, j].map((at) => Math.min(Math.floor(at / perElement), elements - 1));
      vertexElements.push(ej * elements + ei);
      vertexLocal.push(i / perElement - ei, 1, j / perElement - ej);
      const corner = j * (across + 1) + i;
      if (i < across && j < across) quadVertices.push(corner, corner + across + 1, corner + across + 2, corner + 1);
    }
  }
  return create(BodyStructureSchema, {
    nodeCount: nodeRestM.length / 3,
    nodeIds: range(nodeRestM.length / 3),
    nodeRestM,
    elementIds: range(elements * elements),
    elementNodes,
    vertexIds: range(vertexElements.length),
    vertexElements,
    vertexLocal,
    quadIds: range(across * across).map((quad) => 2 * quad),
    quadVertices,
    quantumM: QUANTUM_M,
  });
}

/** A slab of 4 x 4 quads; those that are named become walls, as if the other sides of their links had been laid open. */
export function opened(quads: readonly number[]): BodyStructure {
  const structure = slab(2, 2);
  const { quadIds, quadVertices } = structure;
  const sides = quadIds.flatMap((id, quad) => {
    const vertices = quadVertices.slice(4 * quad, 4 * quad + 4);
    const side = { id, vertices };
    return quads.includes(quad) ? [side, { id: id + 1, vertices: vertices.toReversed() }] : [side];
  });
  structure.quadIds = sides.map(({ id }) => id);
  structure.quadVertices = sides.flatMap(({ vertices }) => vertices);
  return structure;
}
