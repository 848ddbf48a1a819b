// Files for whoever sits at the page: a picture, the surface as GLB.

import { BufferAttribute, BufferGeometry, Group, Mesh } from "three";
import type { Tissue } from "./scene/tissue";

export function download(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** The surface as it is now, one mesh for each kind of face of each object. */
export async function glb(tissues: readonly Tissue[]): Promise<Blob> {
  // Half as large again as the rest of the page, and rarely wanted.
  const { GLTFExporter } = await import("three/addons/exporters/GLTFExporter.js");
  const group = new Group();
  for (const mesh of tissues.flatMap((tissue) => tissue.meshes)) {
    const { start, count } = mesh.geometry.drawRange;
    const index = mesh.geometry.index;
    if (!index || count === 0) continue;
    const geometry = new BufferGeometry();
    geometry.setIndex(new BufferAttribute(index.array.slice(start, start + count), 1));
    for (const name of ["position", "normal", "color"]) {
      const attribute = mesh.geometry.getAttribute(name);
      if (attribute) geometry.setAttribute(name, attribute.clone());
    }
    geometry.normalizeNormals();
    const copy = new Mesh(geometry, mesh.material);
    copy.name = mesh.name;
    group.add(copy);
  }
  const file = await new GLTFExporter().parseAsync(group, { binary: true });
  return new Blob([file as ArrayBuffer], { type: "model/gltf-binary" });
}
