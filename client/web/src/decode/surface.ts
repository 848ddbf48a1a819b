// The surface of one object as arrays that a graphics card takes.
//
// What changes with the structure (triangles, rest positions, materials) is made when it changes; positions and
// normals are made for every state that is shown. Skin and cut faces have their own triangles and normals, so
// that the rim between them stays sharp, and share their positions.

import { joined } from "../pieces";
import type { Body } from "./body";
import { LONG_AGO_S, Seam, seamEdges } from "./seam";

/** What changes only with the structure. Arrays have room to spare; counts say how much of them is used. */
export interface SurfaceStructure {
  vertexCount: number;
  /** Position of each vertex at rest, m. */
  rest: Float32Array<ArrayBuffer>;
  /** Material of each vertex, an index into ObjectSummary.materialNames. */
  materials: Uint8Array<ArrayBuffer>;
  /** Three vertices a triangle, counter-clockwise seen from outside. */
  skin: Uint32Array<ArrayBuffer>;
  skinCount: number;
  cut: Uint32Array<ArrayBuffer>;
  cutCount: number;
  /** Two vertices for each edge at which a wall of a cut meets the skin. */
  seam: Uint32Array<ArrayBuffer>;
  /** Two numbers a vertex: how near it is to a seam, 0 to 1, and the sim time since when, s. */
  rims: Float32Array<ArrayBuffer>;
  /** Two nodes for each edge of the elements; absent where no element has changed. */
  elementEdges?: Uint32Array<ArrayBuffer>;
  /** Area of the cut, m^2 at rest: half that of its two walls. */
  cutAreaM2: number;
  /** Pieces that it has fallen into: closed surfaces that no quad joins and that have tissue within. */
  pieces: number;
}

/** Where the surface is. Normals are as long as the area they stand for. */
export interface SurfaceShape {
  positions: Float32Array<ArrayBuffer>;
  skinNormals: Float32Array<ArrayBuffer>;
  cutNormals: Float32Array<ArrayBuffer>;
  /** Both ends of each edge of the seam. */
  seam: Float32Array<ArrayBuffer>;
}

/** Its arrays, to be handed from thread to thread. */
export function shapeArrays({ positions, skinNormals, cutNormals, seam }: SurfaceShape): Float32Array<ArrayBuffer>[] {
  return [positions, skinNormals, cutNormals, seam];
}

/** Those of a structure. */
export function structureArrays(structure: SurfaceStructure): (Float32Array | Uint32Array | Uint8Array)[] {
  const { rest, materials, skin, cut, seam, rims, elementEdges } = structure;
  return [rest, materials, skin, cut, seam, rims, ...(elementEdges ? [elementEdges] : [])];
}

/** Pairs of an element's corners that its edges join. */
const EDGE_CORNERS = [0, 1, 2, 3, 4, 5, 6, 7, 0, 2, 1, 3, 4, 6, 5, 7, 0, 4, 1, 5, 2, 6, 3, 7];

/** A piece has more than this share of the whole; the server sets none free of fewer than eight voxels. */
const LEAST_PIECE = 1e-4;

/** Room for `count` items: what there was if they fit, so that a cut does not need new arrays with every patch. */
function roomFor(count: number, room: number): number {
  return count <= room ? room : Math.ceil((1.25 * count) / 1024) * 1024;
}

/** Makes the surface of a body. */
export class BodySurface {
  readonly body: Body;
  /** What the object looked like before, until this one is made. */
  private before: BodySurface | undefined;
  /** Changes of the body that it has been made anew for. */
  private changes = -1;
  private elementChanges = -1;
  /** Vertices that arrays have room for, and triangles of either kind. */
  private vertexRoom = 0;
  private skinRoom = 0;
  private cutRoom = 0;
  /** Vertex slots, those of one element side by side. */
  private order = new Uint32Array(0);
  /** Quad slots, the skin's before those of the cut, and how many are the skin's. */
  private quadOrder = new Uint32Array(0);
  private skinQuads = 0;
  /** Vertices beside what is held: slot, weights of the corners' displacements, position at rest, m. */
  private held: { slot: number; weights: readonly number[]; rest: readonly number[] }[] = [];
  /** Ends of the seam's edges, and since when vertices lie there. */
  private seamEnds = new Uint32Array(0);
  private readonly seam = new Seam();
  /** Normals while they are smoothed. */
  private rough = new Float32Array(0);

  /** Seams that an earlier surface of the object has are as old here. */
  constructor(body: Body, before?: BodySurface) {
    this.body = body;
    this.before = before;
  }

  /** The body's structure has changed. */
  get isStale(): boolean {
    return this.changes !== this.body.changes;
  }

  /** To be called after each change of the body's structure; seams that are new are of the sim time `nowS`. */
  restructure(nowS = LONG_AGO_S): SurfaceStructure {
    const { body } = this;
    const quads = body.quadCount;
    this.sortVertices();
    this.sortQuads();
    this.vertexRoom = roomFor(body.vertexCount, this.vertexRoom);
    this.skinRoom = roomFor(2 * this.skinQuads, this.skinRoom);
    this.cutRoom = roomFor(2 * (quads - this.skinQuads), this.cutRoom);
    const rest = new Float32Array(3 * this.vertexRoom);
    this.interpolate(body.nodeRest, rest);
    this.held = Array.from(body.held, ([slot, { weights }]) => {
      return { slot, weights, rest: [...rest.subarray(3 * slot, 3 * slot + 3)] };
    });
    const materials = new Uint8Array(this.vertexRoom);
    materials.set(body.vertexMaterial.subarray(0, body.vertexCount));
    const skin = new Uint32Array(3 * this.skinRoom);
    const cut = new Uint32Array(3 * this.cutRoom);
    this.triangulate(0, this.skinQuads, rest, skin);
    const wallsM2 = this.triangulate(this.skinQuads, quads, rest, cut);
    this.seamEnds = seamEdges(body.quadVertices, this.quadOrder, this.skinQuads, body.vertexCount);
    const hasOtherElements = this.elementChanges !== body.elementChanges;
    this.changes = body.changes;
    this.elementChanges = body.elementChanges;
    return {
      vertexCount: body.vertexCount,
      rest,
      materials,
      skin,
      skinCount: 6 * this.skinQuads,
      cut,
      cutCount: 6 * (quads - this.skinQuads),
      // The page keeps the one, this end the other.
      seam: this.seamEnds.slice(),
      rims: this.seam.rims(this.seamEnds, body.quadVertices, quads, this.vertexRoom, this.seamsBegin(nowS)),
      ...(hasOtherElements && { elementEdges: this.elementEdges() }),
      cutAreaM2: wallsM2 / 2,
      pieces: this.countPieces(rest),
    };
  }

  /**
   * Positions and normals as the last state has them, in arrays of an earlier shape if they are as long. Without
   * adaptation vertices are where their elements have them, whatever blade is there.
   */
  shape(used?: SurfaceShape, isAdapted = true): SurfaceShape {
    const length = 3 * this.vertexRoom;
    const fits = used?.positions.length === length && used.seam.length === 3 * this.seamEnds.length;
    const shape = fits
      ? used
      : {
          positions: new Float32Array(length),
          skinNormals: new Float32Array(length),
          cutNormals: new Float32Array(length),
          seam: new Float32Array(3 * this.seamEnds.length),
        };
    const { body } = this;
    this.interpolate(this.nodePositions(), shape.positions);
    this.placeHeld(shape.positions);
    if (isAdapted) this.adapt(shape.positions);
    this.normals(0, this.skinQuads, shape.positions, shape.skinNormals);
    this.normals(this.skinQuads, body.quadCount, shape.positions, shape.cutNormals);
    this.seamEnds.forEach((vertex, i) => {
      for (let axis = 0; axis < 3; axis++) shape.seam[3 * i + axis] = shape.positions[3 * vertex + axis];
    });
    return shape;
  }

  /** Since when vertices are on a seam that are there for the first time, s. */
  private seamsBegin(nowS: number): (vertex: number) => number {
    const { before } = this;
    this.before = undefined;
    if (!before) return () => nowS;
    const slots = this.body.vertexSlotsIn(before.body);
    return (vertex) => {
      const sinceS = before.seam.sinceS(slots[vertex]);
      return Number.isNaN(sinceS) ? nowS : sinceS;
    };
  }

  private adapt(positions: Float32Array): void {
    const { adaptedSlots, adaptedOffsets } = this.body;
    adaptedSlots.forEach((slot, i) => {
      for (let axis = 0; axis < 3; axis++) positions[3 * slot + axis] += adaptedOffsets[3 * i + axis];
    });
  }

  /** Puts vertices beside what is held where their own weights have them. */
  private placeHeld(positions: Float32Array): void {
    const { elementNodes, vertexElement, nodeDisplacement } = this.body;
    for (const { slot, weights, rest } of this.held) {
      for (let axis = 0; axis < 3; axis++) {
        let at = rest[axis];
        for (let corner = 0; corner < 8; corner++) {
          const node = elementNodes[8 * vertexElement[slot] + corner];
          at += weights[corner] * nodeDisplacement[3 * node + axis];
        }
        positions[3 * slot + axis] = at;
      }
    }
  }

  /** Where the nodes are, m. */
  nodePositions(): Float32Array<ArrayBuffer> {
    const { nodeRest, nodeDisplacement, nodeCount } = this.body;
    const positions = new Float32Array(3 * nodeCount);
    for (let i = 0; i < positions.length; i++) positions[i] = nodeRest[i] + nodeDisplacement[i];
    return positions;
  }

  private sortVertices(): void {
    const { vertexElement, vertexCount, elementCount, hasPlainVertices } = this.body;
    if (hasPlainVertices) return;
    const ends = new Uint32Array(elementCount + 1);
    for (let slot = 0; slot < vertexCount; slot++) ends[vertexElement[slot] + 1]++;
    for (let element = 0; element < elementCount; element++) ends[element + 1] += ends[element];
    this.order = new Uint32Array(vertexCount);
    for (let slot = 0; slot < vertexCount; slot++) this.order[ends[vertexElement[slot]]++] = slot;
  }

  private sortQuads(): void {
    const { quadIsCut, quadCount } = this.body;
    this.quadOrder = new Uint32Array(quadCount);
    let skin = 0;
    let last = quadCount;
    for (let slot = 0; slot < quadCount; slot++) this.quadOrder[quadIsCut[slot] ? --last : skin++] = slot;
    this.skinQuads = skin;
  }

  /** Trilinear values of all vertices, of the values at the nodes. */
  private interpolate(nodes: Float32Array, out: Float32Array): void {
    const { elementNodes, vertexElement, vertexLocal, vertexCount, hasPlainVertices } = this.body;
    if (hasPlainVertices) {
      for (let slot = 0; slot < vertexCount; slot++) {
        for (let axis = 0; axis < 3; axis++) out[3 * slot + axis] = nodes[3 * vertexElement[slot] + axis];
      }
      return;
    }
    const { order } = this;
    // Polynomial of the element whose vertices come next, for each axis: 1, u, v, w, uv, uw, vw, uvw.
    const p = new Float64Array(24);
    let element = -1;
    for (let i = 0; i < order.length; i++) {
      const slot = order[i];
      if (vertexElement[slot] !== element) {
        element = vertexElement[slot];
        elementPolynomial(nodes, elementNodes, 8 * element, p);
      }
      const u = vertexLocal[3 * slot];
      const v = vertexLocal[3 * slot + 1];
      const w = vertexLocal[3 * slot + 2];
      const uv = u * v;
      const uw = u * w;
      const vw = v * w;
      const uvw = uv * w;
      out[3 * slot] = p[0] + p[1] * u + p[2] * v + p[3] * w + p[4] * uv + p[5] * uw + p[6] * vw + p[7] * uvw;
      out[3 * slot + 1] =
        p[8] + p[9] * u + p[10] * v + p[11] * w + p[12] * uv + p[13] * uw + p[14] * vw + p[15] * uvw;
      out[3 * slot + 2] =
        p[16] + p[17] * u + p[18] * v + p[19] * w + p[20] * uv + p[21] * uw + p[22] * vw + p[23] * uvw;
    }
  }

  /**
   * Normals of the faces of one kind: the quads' around each vertex, smoothed over two more. Vertices lie where the
   * voxels have them, which a wet surface would show.
   */
  private normals(from: number, to: number, positions: Float32Array, out: Float32Array): void {
    if (this.rough.length !== out.length) this.rough = new Float32Array(out.length);
    this.sumNormals(from, to, positions, out);
    this.smooth(from, to, out, this.rough);
    this.smooth(from, to, this.rough, out);
  }

  /** Adds the normals of each quad's corners to all of them. */
  private smooth(from: number, to: number, rough: Float32Array, out: Float32Array): void {
    const { quadVertices } = this.body;
    out.fill(0);
    for (let i = from; i < to; i++) {
      const quad = 4 * this.quadOrder[i];
      const a = 3 * quadVertices[quad];
      const b = 3 * quadVertices[quad + 1];
      const c = 3 * quadVertices[quad + 2];
      const d = 3 * quadVertices[quad + 3];
      for (let axis = 0; axis < 3; axis++) {
        const sum = rough[a + axis] + rough[b + axis] + rough[c + axis] + rough[d + axis];
        out[a + axis] += sum;
        out[b + axis] += sum;
        out[c + axis] += sum;
        out[d + axis] += sum;
      }
    }
  }

  /** Adds each quad's area vector to its corners' normals. */
  private sumNormals(from: number, to: number, positions: Float32Array, normals: Float32Array): void {
    const { quadVertices } = this.body;
    normals.fill(0);
    for (let i = from; i < to; i++) {
      const quad = 4 * this.quadOrder[i];
      const a = 3 * quadVertices[quad];
      const b = 3 * quadVertices[quad + 1];
      const c = 3 * quadVertices[quad + 2];
      const d = 3 * quadVertices[quad + 3];
      const acx = positions[c] - positions[a];
      const acy = positions[c + 1] - positions[a + 1];
      const acz = positions[c + 2] - positions[a + 2];
      const bdx = positions[d] - positions[b];
      const bdy = positions[d + 1] - positions[b + 1];
      const bdz = positions[d + 2] - positions[b + 2];
      const x = acy * bdz - acz * bdy;
      const y = acz * bdx - acx * bdz;
      const z = acx * bdy - acy * bdx;
      normals[a] += x;
      normals[a + 1] += y;
      normals[a + 2] += z;
      normals[b] += x;
      normals[b + 1] += y;
      normals[b + 2] += z;
      normals[c] += x;
      normals[c + 1] += y;
      normals[c + 2] += z;
      normals[d] += x;
      normals[d + 1] += y;
      normals[d + 2] += z;
    }
  }

  /** Splits quads along the diagonal from their first vertex, as kerf/v1/view.proto says; answers with their area. */
  private triangulate(from: number, to: number, rest: Float32Array, out: Uint32Array): number {
    const { quadVertices } = this.body;
    const area = new Float64Array(3);
    let areaM2 = 0;
    for (let i = from, at = 0; i < to; i++, at += 6) {
      const quad = 4 * this.quadOrder[i];
      const a = quadVertices[quad];
      const b = quadVertices[quad + 1];
      const c = quadVertices[quad + 2];
      const d = quadVertices[quad + 3];
      out[at] = out[at + 3] = a;
      out[at + 1] = b;
      out[at + 2] = out[at + 4] = c;
      out[at + 5] = d;
      quadArea(rest, a, b, c, d, area);
      areaM2 += Math.hypot(area[0], area[1], area[2]);
    }
    return areaM2;
  }

  /**
   * Joins the corners of each quad; what is left apart are closed surfaces. Those around tissue are pieces; a crack
   * that has not come out to the skin encloses nothing at rest, a hollow less than nothing.
   */
  private countPieces(rest: Float32Array): number {
    const { quadVertices, quadCount, vertexCount } = this.body;
    const root = joined(quadVertices.subarray(0, 4 * quadCount), 4, vertexCount);
    const volumes = new Float64Array(vertexCount);
    const area = new Float64Array(3);
    let total = 0;
    for (let quad = 0; quad < 4 * quadCount; quad += 4) {
      const a = quadVertices[quad];
      const c = quadVertices[quad + 2];
      quadArea(rest, a, quadVertices[quad + 1], c, quadVertices[quad + 3], area);
      let volume = 0;
      for (let axis = 0; axis < 3; axis++) volume += (area[axis] * (rest[3 * a + axis] + rest[3 * c + axis])) / 6;
      volumes[root(a)] += volume;
      total += volume;
    }
    return volumes.reduce((count, volume) => count + (volume > LEAST_PIECE * total ? 1 : 0), 0);
  }

  private elementEdges(): Uint32Array<ArrayBuffer> {
    const { elementNodes, elementCount, nodeCount } = this.body;
    const seen = new Set<number>();
    const edges: number[] = [];
    for (let element = 0; element < elementCount; element++) {
      for (let i = 0; i < EDGE_CORNERS.length; i += 2) {
        const from = elementNodes[8 * element + EDGE_CORNERS[i]];
        const to = elementNodes[8 * element + EDGE_CORNERS[i + 1]];
        const key = Math.min(from, to) * nodeCount + Math.max(from, to);
        if (seen.size < seen.add(key).size) edges.push(from, to);
      }
    }
    return Uint32Array.from(edges);
  }
}

/** Coefficients of the trilinear field of an element, three times eight. */
function elementPolynomial(nodes: Float32Array, elementNodes: Uint32Array, first: number, out: Float64Array): void {
  for (let axis = 0; axis < 3; axis++) {
    const at = (corner: number) => nodes[3 * elementNodes[first + corner] + axis];
    const [c0, c1, c2, c3, c4, c5, c6, c7] = [at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)];
    const p = 8 * axis;
    out[p] = c0;
    out[p + 1] = c1 - c0;
    out[p + 2] = c2 - c0;
    out[p + 3] = c4 - c0;
    out[p + 4] = c3 - c2 - c1 + c0;
    out[p + 5] = c5 - c4 - c1 + c0;
    out[p + 6] = c6 - c4 - c2 + c0;
    out[p + 7] = c7 - c6 - c5 + c4 - c3 + c2 + c1 - c0;
  }
}

/** Area vector of a quad, m^2: half the cross product of its diagonals. */
function quadArea(positions: Float32Array, a: number, b: number, c: number, d: number, out: Float64Array): void {
  const acX = positions[3 * c] - positions[3 * a];
  const acY = positions[3 * c + 1] - positions[3 * a + 1];
  const acZ = positions[3 * c + 2] - positions[3 * a + 2];
  const bdX = positions[3 * d] - positions[3 * b];
  const bdY = positions[3 * d + 1] - positions[3 * b + 1];
  const bdZ = positions[3 * d + 2] - positions[3 * b + 2];
  out[0] = 0.5 * (acY * bdZ - acZ * bdY);
  out[1] = 0.5 * (acZ * bdX - acX * bdZ);
  out[2] = 0.5 * (acX * bdY - acY * bdX);
}
