// What lies beneath the surface of one object: its voxels or its links, coloured by the energy that they hold.

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
/** Colours from no energy to the fracture energy. */
const RAMP = [0x24406e, 0x2f9c95, 0xe8c547, 0xd7322a].map((color) => new Color(color));
const PARTED = new Color(0xffffff);

export class Interior extends Group {
  private readonly fractureEnergyJPerM2: number | undefined;

  /** Without a fracture energy colours go up to the most that any element holds. */
  constructor(fractureEnergyJPerM2: number | undefined) {
    super();
    this.fractureEnergyJPerM2 = fractureEnergyJPerM2;
  }

  show(told: GetInteriorResponse, style: InteriorStyle): void {
    this.dispose();
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

  /** Of each composite element. What it holds per area is what a link in it does. */
  private elementColors({ elementEnergiesJPerM3, voxelSizeM }: GetInteriorResponse): Color[] {
    const most = this.fractureEnergyJPerM2 ?? Math.max(1e-9, ...elementEnergiesJPerM3) * voxelSizeM;
    return elementEnergiesJPerM3.map((energy) => ramp((energy * voxelSizeM) / most));
  }
}

/** The colour of a share of the fracture energy. Its root: energies are squares of strains, which are what is seen. */
function ramp(share: number): Color {
  const place = Math.min(Math.sqrt(Math.max(share, 0)), 1) * (RAMP.length - 1);
  const low = Math.min(Math.floor(place), RAMP.length - 2);
  return RAMP[low].clone().lerp(RAMP[low + 1], place - low);
}
