// Files for whoever sits at the page: a picture, the surface as GLB.

import { BufferAttribute, BufferGeometry, Color, LineSegments, Mesh, MeshStandardMaterial } from "three";
import type { GLTFWriter } from "three/addons/exporters/GLTFExporter.js";
import { type Part, type Piece, splitPieces } from "./pieces";
import type { Tissue } from "./scene/tissue";

/** What is left of a region's colour where skin and cut meet, linear: a cut is seen while it is closed. */
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
 * The surface as it is now: a mesh for each piece of each object, with a primitive for each region, and below it the lines
 * at which skin and cuts meet. A piece of one region is a closed primitive; several are closed together.
 */
export async function glb(tissues: readonly Exported[]): Promise<Blob> {
  // Half as large again as the rest of the page, and rarely wanted.
  const { GLTFExporter } = await import("three/addons/exporters/GLTFExporter.js");
  const meshes: Mesh[] = [];
  const colors = new Map<Mesh, BufferAttribute[]>();
  const seamMaterial = new MeshStandardMaterial({ name: "seam", color: 0, roughness: 1, metalness: 0 });
  for (const tissue of tissues) {
    const regions = regionsOf(tissue);
    const pieces = splitPieces(tissue.parts);
    pieces.forEach((piece, index) => {
      const name = pieces.length === 1 ? tissue.name : `${tissue.name} ${index + 1}`;
      const [mesh, ofPrimitives] = meshOf(piece, tissue.positions, regions);
      mesh.name = name;
      if (piece.seam.length > 0) {
        const lines = new BufferGeometry().setAttribute("position", at(piece.seam, tissue.positions));
        const seam = new LineSegments(lines, seamMaterial);
        seam.name = `${name} seam`;
        mesh.add(seam);
      }
      meshes.push(mesh);
      colors.set(mesh, ofPrimitives);
    });
  }
  const exporter = new GLTFExporter().register((writer) => ({
    writeMesh: (mesh, definition) => {
      definition["name"] = mesh.name;
      addColors(mesh, colors.get(mesh) ?? [], definition as unknown as Definition, writer as Writer);
    },
  }));
  const file = await exporter.parseAsync(meshes, { binary: true });
  return new Blob([file as ArrayBuffer], { type: "model/gltf-binary" });
}

/** What a file has of a mesh. */
interface Definition {
  primitives: { attributes: Record<string, number> }[];
}

/** What the exporter's extensions have, and its types do not. */
type Writer = GLTFWriter & { processAccessor: (attribute: BufferAttribute, geometry: BufferGeometry) => number };

/** Gives each primitive its own colours: from the exporter all of a mesh have the same attributes. */
function addColors({ geometry }: Mesh, colors: readonly BufferAttribute[], { primitives }: Definition, writer: Writer): void {
  colors.forEach((color, index) => {
    const { attributes } = primitives[index];
    primitives[index].attributes = { ...attributes, COLOR_0: writer.processAccessor(color, geometry) };
  });
}

/** A region: its material, and what of the material's colour each face has. */
interface Region extends Record<Part["face"], number[]> {
  material: MeshStandardMaterial;
}

function regionsOf({ looks, materialNames }: Exported): Region[] {
  return looks.map((look, index) => {
    const [skin, cut] = [look.skin, look.cut].map((color) => new Color(color).toArray());
    // The brighter of both in each channel, mostly the cut's: what a vertex has of it is at most all.
    const both = skin.map((channel, i) => Math.max(channel, cut[i]));
    const share = (color: number[]) => color.map((channel, i) => (both[i] > 0 ? channel / both[i] : 1));
    const color = new Color().fromArray(both);
    const material = new MeshStandardMaterial({ name: materialNames[index], color, roughness: 0.55, metalness: 0 });
    return { material, skin: share(skin), cut: share(cut) };
  });
}

/** A mesh of those vertices that a piece has, each once, with a group for each region; and the vertices' colours in each. */
function meshOf({ parts }: Piece, positions: Float32Array, regions: readonly Region[]): [Mesh, BufferAttribute[]] {
  const ofRegions = new Map<number, number[]>();
  for (const { material, triangles } of parts) {
    const region = material in regions ? material : 0;
    ofRegions.set(region, [...(ofRegions.get(region) ?? []), ...triangles]);
  }
  const groups = [...ofRegions].sort(([a], [b]) => a - b);
  const triangles = groups.flatMap(([, ofRegion]) => ofRegion);
  const place = new Map<number, number>();
  for (const vertex of triangles) if (!place.has(vertex)) place.set(vertex, place.size);
  const geometry = new BufferGeometry();
  geometry.setIndex(triangles.map((vertex) => place.get(vertex)!));
  geometry.setAttribute("position", at([...place.keys()], positions));
  geometry.computeVertexNormals();
  let start = 0;
  groups.forEach(([, ofRegion], index) => {
    geometry.addGroup(start, ofRegion.length, index);
    start += ofRegion.length;
  });
  const of = (face: Part["face"]) => new Set(parts.flatMap((part) => (part.face === face ? part.triangles : [])));
  const [onSkin, onCut] = [of("skin"), of("cut")];
  const colors = groups.map(([region]) => {
    const { skin, cut } = regions[region];
    const seam = [SEAM_SHADE, SEAM_SHADE, SEAM_SHADE];
    const rgba = [...place.keys()].flatMap((vertex) => [...(!onCut.has(vertex) ? skin : !onSkin.has(vertex) ? cut : seam), 1]);
    // Of 16 bits: dark ones would show steps of 8.
    return new BufferAttribute(Uint16Array.from(rgba, (share) => Math.round(65535 * share)), 4, true);
  });
  return [new Mesh(geometry, groups.map(([region]) => regions[region].material)), colors];
}

/** Where some vertices are. */
function at(vertices: readonly number[], positions: Float32Array): BufferAttribute {
  const places = vertices.flatMap((vertex) => [positions[3 * vertex], positions[3 * vertex + 1], positions[3 * vertex + 2]]);
  return new BufferAttribute(Float32Array.from(places), 3);
}
