// What hangs together of the surface.

/** Answers with the same vertex for all that polygons of so many `corners` join, and with others for what they do not. */
export function joined(vertices: ArrayLike<number>, corners: number, count: number): (vertex: number) => number {
  const parent = Uint32Array.from({ length: count }, (_, vertex) => vertex);
  const root = (vertex: number) => {
    while (parent[vertex] !== vertex) vertex = parent[vertex] = parent[parent[vertex]];
    return vertex;
  };
  for (let i = 0; i < vertices.length; i++) parent[root(vertices[i])] = root(vertices[i - (i % corners)]);
  return root;
}

/** Three vertices a triangle, of each surface that shares no vertex with another; the largest first. */
export function splitPieces(triangles: Uint32Array): Uint32Array[] {
  const root = joined(triangles, 3, triangles.reduce((most, vertex) => Math.max(most, vertex + 1), 0));
  const pieces = new Map<number, number[]>();
  for (let i = 0; i < triangles.length; i += 3) {
    const of = root(triangles[i]);
    const piece = pieces.get(of) ?? [];
    piece.push(triangles[i], triangles[i + 1], triangles[i + 2]);
    pieces.set(of, piece);
  }
  return [...pieces.values()].sort((a, b) => b.length - a.length).map((piece) => Uint32Array.from(piece));
}
