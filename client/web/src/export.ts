// Files for whoever sits at the page: a picture, the surface as GLB.

import { BufferAttribute, BufferGeometry, Group, LineSegments, Mesh, MeshStandardMaterial } from "three";
import { type Piece, splitPieces } from "./pieces";
import type { Tissue } from "./scene/tissue";

/** What is left of a material's colour where skin and cut meet, linear: a cut is seen while it is closed. */
const SEAM_SHADE = 0.08;

/** What is exported of an object. */
export type Exported = Pick<Tissue, "name" | "parts" | "positions" | "looks" | "materialNames">;

export function download(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/**
 * The surface as it is now: a mesh for each piece of each object, closed by its primitives together, of which each region
 * has one for its skin and one for its cuts; and below it the lines at which they meet.
 */
export async function glb(tissues: readonly Exported[]): Promise<Blob> {
  // Half as large again as the rest of the page, and rarely wanted.
  const { GLTFExporter } = await import("three/addons/exporters/GLTFExporter.js");
  const group = new Group();
  const seamMaterial = new MeshStandardMaterial({ name: "seam", color: 0, roughness: 1, metalness: 0 });
  for (const tissue of tissues) {
    const materials = materialsOf(tissue);
    const pieces = splitPieces(tissue.parts);
    pieces.forEach((piece, index) => {
      const name = pieces.length === 1 ? tissue.name : `${tissue.name} ${index + 1}`;
      const mesh = meshOf(piece, tissue.positions, materials);
      mesh.name = name;
      if (piece.seam.length > 0) {
        const lines = new BufferGeometry().setAttribute("position", at(piece.seam, tissue.positions));
        const seam = new LineSegments(lines, seamMaterial);
        seam.name = `${name} seam`;
        mesh.add(seam);
      }
      group.add(mesh);
    });
  }
  const file = await new GLTFExporter().parseAsync(group, { binary: true });
  return new Blob([file as ArrayBuffer], { type: "model/gltf-binary" });
}

type Materials = Record<"skin" | "cut", MeshStandardMaterial>[];

function materialsOf({ looks, materialNames }: Exported): Materials {
  const material = (name: string, color: number) =>
    new MeshStandardMaterial({ name, color, vertexColors: true, roughness: 0.55, metalness: 0 });
  return looks.map(({ skin, cut }, index) => ({
    skin: material(materialNames[index], skin),
    cut: material(`${materialNames[index]} cut`, cut),
  }));
}

/** A mesh of those vertices that a piece has, each once; its parts are groups of triangles. */
function meshOf({ parts, seam }: Piece, positions: Float32Array, materials: Materials): Mesh {
  const triangles = parts.flatMap((part) => part.triangles);
  const place = new Map<number, number>();
  for (const vertex of triangles) if (!place.has(vertex)) place.set(vertex, place.size);
  const geometry = new BufferGeometry();
  geometry.setIndex(triangles.map((vertex) => place.get(vertex)!));
  geometry.setAttribute("position", at([...place.keys()], positions));
  const dark = new Set(seam);
  const shades = [...place.keys()].flatMap((vertex) => new Array<number>(3).fill(dark.has(vertex) ? SEAM_SHADE : 1));
  geometry.setAttribute("color", new BufferAttribute(Float32Array.from(shades), 3));
  geometry.computeVertexNormals();
  let start = 0;
  parts.forEach((part, index) => {
    geometry.addGroup(start, part.triangles.length, index);
    start += part.triangles.length;
  });
  return new Mesh(geometry, parts.map(({ face, material }) => (materials[material] ?? materials[0])[face]));
}

/** Where some vertices are. */
function at(vertices: readonly number[], positions: Float32Array): BufferAttribute {
  const places = vertices.flatMap((vertex) => [positions[3 * vertex], positions[3 * vertex + 1], positions[3 * vertex + 2]]);
  return new BufferAttribute(Float32Array.from(places), 3);
}
