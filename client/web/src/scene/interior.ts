// What lies beneath the surface of one object: its voxels or its links, coloured by the elastic energy that is in them.

import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  Color,
  Group,
  InstancedMesh,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  MeshStandardMaterial,
} from "three";
import type { GetInteriorResponse } from "../gen/kerf/v1/view_pb";

export type InteriorStyle = "voxels" | "links";

/** Edge of a voxel as it is drawn, in voxels: they can be told apart. */
const DRAWN_EDGE = 0.86;
/** Colours from no energy to the most that was seen. */
export const RAMP = ["#24406e", "#2f9c95", "#e8c547", "#d7322a"];
const RAMP_COLORS = RAMP.map((color) => new Color(color));
const PARTED = new Color(0xffffff);

export class Interior extends Group {
  /** The most that any element has held, J/m^3: what the last colour stands for, so that it means the same all along. */
  mostJPerM3 = 0;

  show(told: GetInteriorResponse, style: InteriorStyle): void {
    this.dispose();
    this.mostJPerM3 = told.elementEnergiesJPerM3.reduce((most, energy) => Math.max(most, energy), this.mostJPerM3);
    this.add(style === "voxels" ? this.voxels(told) : this.links(told));
  }

  override dispose(): void {
    for (const child of this.children as (InstancedMesh<BoxGeometry, MeshStandardMaterial> | LineSegments)[]) {
      child.geometry.dispose();
      (child.material as MeshStandardMaterial | LineBasicMaterial).dispose();
      if (child instanceof InstancedMesh) child.dispose();
    }
    this.clear();
  }

  private voxels(told: GetInteriorResponse): InstancedMesh {
    const { voxelPositionsM: at, voxelElements, voxelSizeM } = told;
    const edgeM = DRAWN_EDGE * voxelSizeM;
    const material = new MeshStandardMaterial({ roughness: 0.7 });
    const mesh = new InstancedMesh(new BoxGeometry(edgeM, edgeM, edgeM), material, voxelElements.length);
    mesh.frustumCulled = false;
    mesh.castShadow = mesh.receiveShadow = true;
    const colors = this.elementColors(told);
    const place = new Matrix4();
    voxelElements.forEach((element, i) => {
      mesh.setMatrixAt(i, place.makeTranslation(at[3 * i], at[3 * i + 1], at[3 * i + 2]));
      mesh.setColorAt(i, colors[element]);
    });
    return mesh;
  }

  private links(told: GetInteriorResponse): LineSegments {
    const { voxelPositionsM: at, voxelElements, intactLinks, partedLinks } = told;
    const ends = [...intactLinks, ...partedLinks];
    const colors = this.elementColors(told);
    const color = new Float32Array(3 * ends.length);
    ends.forEach((voxel, i) => (i < intactLinks.length ? colors[voxelElements[voxel]] : PARTED).toArray(color, 3 * i));
    const geometry = new BufferGeometry();
    // Colours are of ends of links, so every end has a place of its own.
    const position = new Float32Array(3 * ends.length);
    ends.forEach((voxel, i) => position.set(at.slice(3 * voxel, 3 * voxel + 3), 3 * i));
    geometry.setAttribute("position", new BufferAttribute(position, 3));
    geometry.setAttribute("color", new BufferAttribute(color, 3));
    // One sees through the outer ones to those within.
    const lines = new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.35, depthWrite: false }));
    lines.frustumCulled = false;
    return lines;
  }

  private elementColors({ elementEnergiesJPerM3 }: GetInteriorResponse): Color[] {
    const mostJPerM3 = Math.max(this.mostJPerM3, Number.MIN_VALUE);
    return elementEnergiesJPerM3.map((energy) => ramp(energy / mostJPerM3));
  }
}

/** The colour of a share of the most energy. Its root: energies are squares of strains, which are what is seen. */
function ramp(share: number): Color {
  const place = Math.min(Math.sqrt(Math.max(share, 0)), 1) * (RAMP_COLORS.length - 1);
  const low = Math.min(Math.floor(place), RAMP_COLORS.length - 2);
  return RAMP_COLORS[low].clone().lerp(RAMP_COLORS[low + 1], place - low);
}
