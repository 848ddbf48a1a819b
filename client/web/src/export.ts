// Files for whoever sits at the page: a picture, the surface as GLB.

import { BufferAttribute, BufferGeometry, Group, Mesh, MeshStandardMaterial } from "three";
import { splitPieces } from "./pieces";
import type { Tissue } from "./scene/tissue";

export function download(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** The surface as it is now, a closed mesh for each piece of each object; what is skin, wall or seam is told by colours. */
export async function glb(tissues: readonly Tissue[]): Promise<Blob> {
  // Half as large again as the rest of the page, and rarely wanted.
  const { GLTFExporter } = await import("three/addons/exporters/GLTFExporter.js");
  const group = new Group();
  const material = new MeshStandardMaterial({ vertexColors: true, roughness: 0.55, metalness: 0 });
  for (const tissue of tissues) {
    const { positions, vertexColors } = tissue;
    const pieces = splitPieces(tissue.triangles);
    pieces.forEach((triangles, index) => {
      const mesh = new Mesh(pieceOf(triangles, positions, vertexColors), material);
      mesh.name = pieces.length === 1 ? tissue.name : `${tissue.name} ${index + 1}`;
      group.add(mesh);
    });
  }
  const file = await new GLTFExporter().parseAsync(group, { binary: true });
  return new Blob([file as ArrayBuffer], { type: "model/gltf-binary" });
}

/** A mesh of some of the vertices, each once. */
function pieceOf(triangles: Uint32Array, positions: Float32Array, colors: Float32Array): BufferGeometry {
  const place = new Map<number, number>();
  for (const vertex of triangles) if (!place.has(vertex)) place.set(vertex, place.size);
  const taken = (from: Float32Array) =>
    Float32Array.from([...place.keys()].flatMap((vertex) => [from[3 * vertex], from[3 * vertex + 1], from[3 * vertex + 2]]));
  const geometry = new BufferGeometry();
  geometry.setIndex(new BufferAttribute(triangles.map((vertex) => place.get(vertex)!), 1));
  geometry.setAttribute("position", new BufferAttribute(taken(positions), 3));
  geometry.setAttribute("color", new BufferAttribute(taken(colors), 3));
  geometry.computeVertexNormals();
  return geometry;
}
