// Triangles by the closed surfaces that they make up.

/** Three vertices a triangle, of each surface that shares no vertex with another; the largest first. */
export function splitPieces(triangles: Uint32Array): Uint32Array[] {
  const parent = new Map<number, number>();
  const root = (vertex: number): number => {
    let at = vertex;
    for (let up = parent.get(at) ?? at; up !== at; up = parent.get(at) ?? at) {
      parent.set(at, parent.get(up) ?? up);
      at = up;
    }
    return at;
  };
  for (let i = 0; i < triangles.length; i += 3) {
    for (const other of [triangles[i + 1], triangles[i + 2]]) parent.set(root(other), root(triangles[i]));
  }
  const pieces = new Map<number, number[]>();
  for (let i = 0; i < triangles.length; i += 3) {
    const of = root(triangles[i]);
    const piece = pieces.get(of) ?? [];
    piece.push(triangles[i], triangles[i + 1], triangles[i + 2]);
    pieces.set(of, piece);
  }
  return [...pieces.values()].sort((a, b) => b.length - a.length).map((piece) => Uint32Array.from(piece));
}
