// Where the walls of cuts meet the skin. A cut that has closed again shows nowhere else.

/** Sim time at which a seam counts as begun that was there before anybody looked, s: long ago. */
export const LONG_AGO_S = -1000;

/** How much of the seam's shading the neighbours of its vertices have. */
const BESIDE = 0.3;

/**
 * Edges that a quad of the skin shares with one of a wall: two vertices each, each edge once. Quads come in the order of
 * `order`, the first `skinQuads` of them the skin's.
 */
export function seamEdges(
  quadVertices: Uint32Array,
  order: Uint32Array,
  skinQuads: number,
  vertexCount: number,
): Uint32Array<ArrayBuffer> {
  const isOnWall = new Uint8Array(vertexCount);
  const walls = new Set<number>();
  const edges: number[] = [];
  const each = (from: number, to: number, take: (a: number, b: number) => void) => {
    for (let i = from; i < to; i++) {
      const quad = 4 * order[i];
      for (let corner = 0; corner < 4; corner++) {
        take(quadVertices[quad + corner], quadVertices[quad + ((corner + 1) & 3)]);
      }
    }
  };
  const key = (a: number, b: number) => Math.min(a, b) * vertexCount + Math.max(a, b);
  each(skinQuads, order.length, (a, b) => {
    isOnWall[a] = isOnWall[b] = 1;
    walls.add(key(a, b));
  });
  each(0, skinQuads, (a, b) => {
    // Few vertices of the skin are on a wall: the others are not looked up.
    if (isOnWall[a] === 1 && isOnWall[b] === 1 && walls.delete(key(a, b))) edges.push(a, b);
  });
  return Uint32Array.from(edges);
}

/** What is known of the vertices along seams, by their slots, as cuts go on. */
export class Seam {
  /** Sim time at which each vertex came to lie on a seam, s; NaN: it never did. */
  private bornS = new Float32Array(0);

  /** Since when a vertex has been on a seam, s; NaN: it never was, or there is no such vertex. */
  sinceS(vertex: number): number {
    return this.bornS[vertex] ?? Number.NaN;
  }

  /**
   * Two numbers a vertex, in room for `vertexRoom`: how strongly it shows that a cut ends there, 1 on a seam, and the
   * sim time at which it began to, s. Of a vertex that has come to lie on one, `beginS` says since when.
   */
  rims(
    edges: Uint32Array,
    quadVertices: Uint32Array,
    quadCount: number,
    vertexRoom: number,
    beginS: (vertex: number) => number,
  ): Float32Array<ArrayBuffer> {
    if (this.bornS.length < vertexRoom) {
      const longer = new Float32Array(vertexRoom).fill(Number.NaN);
      longer.set(this.bornS);
      this.bornS = longer;
    }
    const rims = new Float32Array(2 * vertexRoom);
    for (const vertex of edges) {
      if (Number.isNaN(this.bornS[vertex])) this.bornS[vertex] = beginS(vertex);
      rims[2 * vertex] = 1;
      rims[2 * vertex + 1] = this.bornS[vertex];
    }
    if (edges.length === 0) return rims;
    for (let quad = 0; quad < 4 * quadCount; quad += 4) {
      let bornS = Number.NEGATIVE_INFINITY;
      for (let corner = quad; corner < quad + 4; corner++) {
        const vertex = quadVertices[corner];
        if (rims[2 * vertex] === 1) bornS = Math.max(bornS, rims[2 * vertex + 1]);
      }
      if (bornS === Number.NEGATIVE_INFINITY) continue;
      for (let corner = quad; corner < quad + 4; corner++) {
        const vertex = quadVertices[corner];
        if (rims[2 * vertex] === 1) continue;
        rims[2 * vertex + 1] = rims[2 * vertex] === 0 ? bornS : Math.max(bornS, rims[2 * vertex + 1]);
        rims[2 * vertex] = BESIDE;
      }
    }
    return rims;
  }
}
