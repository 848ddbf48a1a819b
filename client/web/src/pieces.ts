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

/** The faces of a surface, three vertices a triangle, and the edges at which they meet, two vertices each. */
export interface Faces {
  skin: Uint32Array;
  cut: Uint32Array;
  seam: Uint32Array;
  /** Material of each vertex. */
  materials: ArrayLike<number>;
}

/** Triangles of one face and one material. */
export interface Part {
  face: "skin" | "cut";
  material: number;
  triangles: number[];
}

/** A surface that shares no vertex with another. */
export interface Piece {
  parts: Part[];
  seam: number[];
}

/** The pieces of a surface, that of most triangles first, each in parts by face and material. */
export function splitPieces({ skin, cut, seam, materials }: Faces): Piece[] {
  const all = Uint32Array.from([...skin, ...cut]);
  const root = joined(all, 3, all.reduce((most, vertex) => Math.max(most, vertex + 1), 0));
  const pieces = new Map<number, Map<string, Part>>();
  for (let i = 0; i < all.length; i += 3) {
    const [a, b, c] = [all[i], all[i + 1], all[i + 2]];
    const face = i < skin.length ? "skin" : "cut";
    // That of two corners, where the third is of another region.
    const material = materials[b] === materials[c] ? materials[b] : materials[a];
    const parts = pieces.get(root(a)) ?? new Map<string, Part>();
    const part = parts.get(`${material} ${face}`) ?? { face, material, triangles: [] };
    part.triangles.push(a, b, c);
    parts.set(`${material} ${face}`, part);
    pieces.set(root(a), parts);
  }
  const edges = new Map<number, number[]>();
  for (let i = 0; i < seam.length; i += 2) {
    const of = edges.get(root(seam[i])) ?? [];
    of.push(seam[i], seam[i + 1]);
    edges.set(root(seam[i]), of);
  }
  const split = [...pieces].map(([of, parts]) => ({ parts: [...parts.values()], seam: edges.get(of) ?? [] }));
  const size = ({ parts }: Piece) => parts.reduce((sum, { triangles }) => sum + triangles.length, 0);
  return split.sort((a, b) => size(b) - size(a));
}
