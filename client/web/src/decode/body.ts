// One object: its lattice, the surface bound to it, and where the nodes are.

import type { BodyState, BodyStructure } from "../gen/kerf/v1/view_pb";
import { checkAscending, checkFinite, checkLength, FieldError, unknownId } from "./check";
import { decodeExactly, decodeIntegers } from "./integers";
import { add, heldHash, quadHash, subtract, vertexHash, type Word } from "./hash";
import { grown, Slots } from "./store";

/** Most node slots of all objects together: 12 bytes for each are still one message. */
export const MAX_NODES = (64 << 20) / 12;

/** Every vertex refers to an element, every element to nodes, every quad to vertices that exist. */
export class Body {
  /** Vertices are nodes themselves: `SURFACE_ENCODING_VERTICES`. */
  readonly hasPlainVertices: boolean;
  nodeCount = 0;
  /** Rest position by node slot, m; NaN for a slot without a node. */
  nodeRest = new Float32Array(0);
  /** Displacement by node slot, m. */
  nodeDisplacement = new Float32Array(0);
  /** Unit of what comes with states, m. */
  private quantum = 0;
  /** What displacements are differences to, in quanta, by node slot; and what the state in hand has there. */
  private reference = new Int32Array(0);
  private newReference = new Int32Array(0);
  private differences = new Int32Array(0);

  private readonly elements = new Slots();
  /** Eight node slots by element slot; corner c at (c & 1, c >> 1 & 1, c >> 2). */
  elementNodes = new Uint32Array(0);

  private readonly vertices = new Slots();
  /** By vertex slot: slot of its element (of its node, of a plain one), trilinear coordinates there, material of its voxel, hash. */
  vertexElement = new Uint32Array(0);
  vertexLocal = new Float32Array(0);
  vertexMaterial = new Uint8Array(0);
  private vertexHashes = new Uint32Array(0);
  /** Vertices beside what is held, by vertex slot: weights of the corners' displacements, and their hash. */
  readonly held = new Map<number, { readonly weights: readonly number[]; readonly hash: Word }>();

  private readonly quads = new Slots();
  /** By quad slot: slots of its corners, counter-clockwise seen from outside; whether a blade laid it open; hash. */
  quadVertices = new Uint32Array(0);
  quadIsCut = new Uint8Array(0);
  private quadHashes = new Uint32Array(0);

  /** What the state in hand says of vertices that are adapted: slots, and offsets in quanta. */
  private readSlots: ArrayLike<number> = [];
  private readOffsets: ArrayLike<number> = [];
  /** Vertices that are not where their elements have them, and their offsets, m. */
  adaptedSlots = new Uint32Array(0);
  adaptedOffsets = new Float32Array(0);

  /** How many changes of the structure there were, and how many of them were of elements too. */
  changes = 0;
  elementChanges = 0;

  /** Sum of the hashes of the vertices, weights and quads, kept as they come. */
  readonly hashSum: Word = { hi: 0, lo: 0 };

  constructor(hasPlainVertices = false) {
    this.hasPlainVertices = hasPlainVertices;
  }

  get elementCount(): number {
    return this.elements.count;
  }

  get vertexCount(): number {
    return this.vertices.count;
  }

  get quadCount(): number {
    return this.quads.count;
  }

  /** Where a vertex is in the arrays above. */
  vertexSlot(id: number): number | undefined {
    return this.vertices.get(id);
  }

  /** By vertex slot, the slot that the same vertex has in another body; -1: none. */
  vertexSlotsIn(other: Body): Int32Array {
    return this.vertices.slotsIn(other.vertices);
  }

  /** Whether another one has the same structure: the same of everything under the same ids. */
  hasStructureOf(other: Body): boolean {
    if (!this.hasCountsOf(other)) return false;
    const elements = this.elements.slotsIn(other.elements);
    const vertices = this.vertexSlotsIn(other);
    const quads = this.quads.slotsIn(other.quads);
    return (
      // A slot without a node has NaN.
      this.nodeRest.subarray(0, 3 * this.nodeCount).every((at, i) => Object.is(at, other.nodeRest[i])) &&
      areSame(this.elementNodes, other.elementNodes, 8, elements) &&
      areSame(this.vertexElement, other.vertexElement, 1, vertices, this.hasPlainVertices ? undefined : elements) &&
      areSame(this.vertexLocal, other.vertexLocal, 3, vertices) &&
      areSame(this.vertexMaterial, other.vertexMaterial, 1, vertices) &&
      areSame(this.quadVertices, other.quadVertices, 4, quads, vertices) &&
      areSame(this.quadIsCut, other.quadIsCut, 1, quads) &&
      [...this.held].every(([slot, { weights }]) => {
        const theirs = other.held.get(vertices[slot]);
        return theirs !== undefined && weights.every((weight, i) => weight === theirs.weights[i]);
      })
    );
  }

  /** The part of `hasStructureOf` that takes no time. */
  private hasCountsOf(other: Body): boolean {
    const counts = ({ hasPlainVertices, quantum, nodeCount, hashSum, elements, vertices, quads, held }: Body) => [
      hasPlainVertices,
      quantum,
      nodeCount,
      hashSum.hi,
      hashSum.lo,
      elements.count,
      vertices.count,
      quads.count,
      held.size,
    ];
    const theirs = counts(other);
    return counts(this).every((count, i) => count === theirs[i]);
  }

  /**
   * Applies what a keyframe (to an empty body) or a patch says; `room` is for how many node slots. After an error the body
   * is not to be used.
   */
  change(change: BodyStructure, room = MAX_NODES): void {
    const { nodeIds, elementIds, vertexIds, heldVertexIds, quadIds } = change;
    if ([nodeIds, elementIds, vertexIds, heldVertexIds, quadIds].some(({ length }) => length > 0)) this.changes += 1;
    if (elementIds.length > 0) this.elementChanges += 1;
    this.setQuantum(change);
    this.upsertNodes(change, room);
    if (this.hasPlainVertices) {
      this.upsertPlainVertices(change);
    } else {
      this.upsertElements(change);
      this.upsertVertices(change);
      this.upsertHeld(change);
    }
    this.upsertQuads(change);
  }

  /** Reads a state, which is refused before any of it is taken over; `displace` takes it over. */
  readState(state: BodyState, hasReference: boolean): void {
    if (this.differences.length !== 3 * this.nodeCount) {
      const reference = new Int32Array(3 * this.nodeCount);
      reference.set(this.reference);
      this.reference = reference;
      this.newReference = new Int32Array(3 * this.nodeCount);
      this.differences = new Int32Array(3 * this.nodeCount);
    }
    decodeExactly("displacements", state.displacements, this.differences);
    if (hasReference) {
      this.newReference.fill(0);
      decodeIntegers("reference", state.reference, this.newReference);
    }
    this.readAdapted(state);
  }

  private readAdapted(state: BodyState): void {
    if (state.adaptedIds.length === 0 && state.adaptedOffsets.length === 0) {
      this.readSlots = this.readOffsets = [];
      return;
    }
    const steps = new Float64Array(this.vertices.count);
    const count = decodeIntegers("adapted_ids", state.adaptedIds, steps);
    const slots = new Uint32Array(count);
    for (let i = 0, id = 0; i < count; i++) {
      id += steps[i];
      const slot = this.vertices.get(id);
      if (slot === undefined) throw unknownId("adapted_ids", id);
      if (i > 0 && steps[i] <= 0) {
        throw new FieldError("adapted_ids", `entry ${i}, id ${id}, is not above the one before it`);
      }
      slots[i] = slot;
    }
    const offsets = new Int32Array(3 * count);
    decodeExactly("adapted_offsets", state.adaptedOffsets, offsets);
    this.readSlots = slots;
    this.readOffsets = offsets;
  }

  /** Takes over the state that `readState` has read. */
  displace(hasReference: boolean): void {
    if (hasReference) [this.reference, this.newReference] = [this.newReference, this.reference];
    const { reference, differences, nodeDisplacement, quantum } = this;
    for (let i = 0; i < differences.length; i++) nodeDisplacement[i] = (reference[i] + differences[i]) * quantum;
    this.adaptedSlots = Uint32Array.from(this.readSlots);
    this.adaptedOffsets = Float32Array.from(this.readOffsets, (offset) => offset * quantum);
  }

  private setQuantum(change: BodyStructure): void {
    // A patch leaves it as it is.
    if (change.quantumM === 0 && this.quantum > 0) return;
    if (!(change.quantumM > 0 && change.quantumM < Infinity)) {
      throw new FieldError("quantum_m", `${change.quantumM} is not above 0`);
    }
    this.quantum = change.quantumM;
  }

  private upsertNodes(change: BodyStructure, room: number): void {
    const { nodeCount, nodeIds, nodeRestM } = change;
    if (nodeCount < this.nodeCount || nodeCount > room) {
      throw new FieldError("node_count", `${nodeCount} is outside ${this.nodeCount}..${room}`);
    }
    checkAscending("node_ids", nodeIds);
    checkLength("node_rest_m", nodeRestM, 3 * nodeIds.length);
    checkFinite("node_rest_m", nodeRestM);
    this.nodeRest = grown(this.nodeRest, 3 * nodeCount).fill(Number.NaN, 3 * this.nodeCount);
    this.nodeDisplacement = grown(this.nodeDisplacement, 3 * nodeCount);
    this.nodeCount = nodeCount;
    nodeIds.forEach((id, i) => {
      if (id >= nodeCount) throw unknownId("node_ids", id);
      for (let axis = 0; axis < 3; axis++) this.nodeRest[3 * id + axis] = nodeRestM[3 * i + axis];
    });
  }

  private upsertElements(change: BodyStructure): void {
    const { elementIds, elementNodes } = change;
    checkAscending("element_ids", elementIds);
    checkLength("element_nodes", elementNodes, 8 * elementIds.length);
    this.elementNodes = grown(this.elementNodes, 8 * (this.elements.count + elementIds.length));
    elementIds.forEach((id, i) => {
      const slot = this.elements.claim(id);
      for (let corner = 0; corner < 8; corner++) {
        const node = elementNodes[8 * i + corner];
        const exists = node < this.nodeCount && !Number.isNaN(this.nodeRest[3 * node]);
        if (!exists) throw unknownId("element_nodes", node);
        this.elementNodes[8 * slot + corner] = node;
      }
    });
  }

  private upsertVertices(change: BodyStructure): void {
    const { vertexIds, vertexElements, vertexLocal, vertexMaterials } = change;
    const count = vertexIds.length;
    checkAscending("vertex_ids", vertexIds);
    checkLength("vertex_elements", vertexElements, count);
    checkLength("vertex_local", vertexLocal, 3 * count);
    checkFinite("vertex_local", vertexLocal);
    if (vertexMaterials.length > 0) checkLength("vertex_materials", vertexMaterials, count);
    const local = Float32Array.from(vertexLocal);
    const bits = new Uint32Array(local.buffer);
    const total = this.vertices.count + count;
    this.vertexElement = grown(this.vertexElement, total);
    this.vertexLocal = grown(this.vertexLocal, 3 * total);
    this.vertexMaterial = grown(this.vertexMaterial, total);
    this.vertexHashes = grown(this.vertexHashes, 2 * total);
    vertexIds.forEach((id, i) => {
      const element = this.elements.get(vertexElements[i]);
      if (element === undefined) throw unknownId("vertex_elements", vertexElements[i]);
      const slot = this.vertices.claim(id);
      this.release(slot);
      this.vertexElement[slot] = element;
      this.vertexLocal.set(local.subarray(3 * i, 3 * i + 3), 3 * slot);
      const material = vertexMaterials[i] ?? 0;
      this.vertexMaterial[slot] = material;
      const hash = vertexHash(id, vertexElements[i], material, bits[3 * i], bits[3 * i + 1], bits[3 * i + 2]);
      this.exchangeHash(this.vertexHashes, slot, hash);
    });
  }

  private upsertPlainVertices({ nodeIds, vertexMaterials }: BodyStructure): void {
    if (vertexMaterials.length > 0) checkLength("vertex_materials", vertexMaterials, nodeIds.length);
    const total = this.vertices.count + nodeIds.length;
    this.vertexElement = grown(this.vertexElement, total);
    this.vertexMaterial = grown(this.vertexMaterial, total);
    nodeIds.forEach((id, i) => {
      const slot = this.vertices.claim(id);
      this.vertexElement[slot] = id;
      this.vertexMaterial[slot] = vertexMaterials[i] ?? 0;
    });
  }

  private upsertHeld(change: BodyStructure): void {
    const { heldVertexIds, heldVertexWeights } = change;
    checkAscending("held_vertex_ids", heldVertexIds);
    checkLength("held_vertex_weights", heldVertexWeights, 8 * heldVertexIds.length);
    checkFinite("held_vertex_weights", heldVertexWeights);
    heldVertexIds.forEach((id, i) => {
      const slot = this.vertices.get(id);
      if (slot === undefined) throw unknownId("held_vertex_ids", id);
      this.release(slot);
      const weights = heldVertexWeights.slice(8 * i, 8 * i + 8);
      const hash = heldHash(id, weights);
      this.held.set(slot, { weights, hash });
      add(this.hashSum, hash.hi, hash.lo);
    });
  }

  /** Forgets what is held beside a vertex. */
  private release(slot: number): void {
    const held = this.held.get(slot);
    if (held === undefined) return;
    subtract(this.hashSum, held.hash.hi, held.hash.lo);
    this.held.delete(slot);
  }

  private upsertQuads(change: BodyStructure): void {
    const { quadIds, quadVertices } = change;
    checkAscending("quad_ids", quadIds);
    checkLength("quad_vertices", quadVertices, 4 * quadIds.length);
    const total = this.quads.count + quadIds.length;
    this.quadVertices = grown(this.quadVertices, 4 * total);
    this.quadIsCut = grown(this.quadIsCut, total);
    this.quadHashes = grown(this.quadHashes, 2 * total);
    quadIds.forEach((id, i) => {
      const slot = this.quads.claim(id);
      for (let corner = 0; corner < 4; corner++) {
        const vertex = this.vertices.get(quadVertices[4 * i + corner]);
        if (vertex === undefined) throw unknownId("quad_vertices", quadVertices[4 * i + corner]);
        this.quadVertices[4 * slot + corner] = vertex;
      }
      // The other side of the link exists only where a blade parted it.
      const partner = this.quads.get((id ^ 1) >>> 0);
      this.quadIsCut[slot] = partner === undefined ? 0 : 1;
      if (partner !== undefined) this.quadIsCut[partner] = 1;
      const [a, b, c, d] = quadVertices.slice(4 * i, 4 * i + 4);
      this.exchangeHash(this.quadHashes, slot, quadHash(id, a, b, c, d));
    });
  }

  private exchangeHash(hashes: Uint32Array, slot: number, hash: Word): void {
    subtract(this.hashSum, hashes[2 * slot], hashes[2 * slot + 1]);
    add(this.hashSum, hash.hi, hash.lo);
    hashes[2 * slot] = hash.hi;
    hashes[2 * slot + 1] = hash.lo;
  }
}

/**
 * Whether items are the same, `width` numbers each: those of a slot here and of the slot there that `slots` has for it, -1
 * for none. Numbers that are slots themselves are so by `names`.
 */
function areSame(
  ours: ArrayLike<number>,
  theirs: ArrayLike<number>,
  width: number,
  slots: Int32Array,
  names?: Int32Array,
): boolean {
  for (let i = 0; i < width * slots.length; i++) {
    const slot = Math.floor(i / width);
    const our = names ? names[ours[i]] : ours[i];
    if (our !== theirs[width * slots[slot] + (i - width * slot)]) return false;
  }
  return true;
}
