// One object as it is drawn: skin and cut faces over the same positions.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  type MeshPhysicalMaterial,
} from "three";
import type { SurfaceShape, SurfaceStructure } from "../decode/surface";
import type { BodyFrame } from "../net/frames";
import type { Faces } from "../pieces";
import type { InteriorStyle } from "./interior";
import { type Look, lookOf } from "./looks";
import { AGED_S, type SeamDress, SeamLine } from "./seam-line";
import { tissueMaterial } from "./tissue-material";

type Face = "skin" | "cut";

/** What the tissue is drawn as. */
export type Style = "tissue" | "unadapted" | "wires" | "elements" | InteriorStyle;

/** Ways of drawing that show the edges of the elements. */
export function showsElements(style: Style): boolean {
  return style === "elements" || style === "voxels";
}

export class Tissue extends Group {
  /** What each of its materials looks like. */
  readonly looks: readonly Look[];
  private readonly faces: Record<Face, Mesh<BufferGeometry, MeshPhysicalMaterial>>;
  private readonly edges: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly seam: SeamLine;
  /** Of the picture that is shown, s. */
  private readonly nowS = { value: 0 };
  private shape: SurfaceShape | undefined;
  private vertexCount = 0;
  /** Material of each vertex. */
  private materials = new Uint8Array(0);
  /** Two vertices for each edge at which skin and walls meet. */
  private seamEdges = new Uint32Array(0);
  /** Sim time at which the youngest part of a seam has its last colour, s. */
  private agedAtS = Number.NEGATIVE_INFINITY;
  /** Area of the cut, m^2 at rest. */
  cutAreaM2 = 0;
  /** Whether the last frame has it look other than the one before. */
  looksNew = true;

  /** `sizeM` is the size of the object, which the size of its blotches follows. */
  constructor(name: string, readonly materialNames: readonly string[], colors: readonly string[], sizeM: number) {
    super();
    this.name = name;
    this.looks = materialNames.map((name, index) => lookOf(name, index, colors[index]));
    const face = (kind: Face) => {
      const material = tissueMaterial(this.looks[0], kind, 14 / sizeM, this.nowS);
      if (this.looks.length > 1) {
        material.vertexColors = true;
        material.color.set(0xffffff);
      }
      const mesh = new Mesh(new BufferGeometry(), material);
      mesh.name = `${materialNames[0]} ${kind}`;
      mesh.castShadow = mesh.receiveShadow = true;
      mesh.frustumCulled = false;
      return mesh;
    };
    this.faces = { skin: face("skin"), cut: face("cut") };
    const lines = new LineBasicMaterial({ color: 0x9fd8ff, transparent: true, opacity: 0.55, depthWrite: false });
    this.edges = new LineSegments(new BufferGeometry(), lines);
    this.edges.frustumCulled = false;
    this.edges.visible = false;
    this.seam = new SeamLine(sizeM);
    this.add(this.faces.skin, this.faces.cut, this.edges, this.seam);
    // Drawn before there are normals, the material would be flat for good.
    this.visible = false;
  }

  /** The meshes that a ray may hit. */
  get meshes(): Mesh[] {
    return [this.faces.skin, this.faces.cut];
  }

  /** Positions of the vertices now, m. */
  get positions(): Float32Array {
    return this.shape?.positions.subarray(0, 3 * this.vertexCount) ?? new Float32Array(0);
  }

  /** The skin, the walls of cuts, and where they meet. */
  get parts(): Faces {
    const of = ({ geometry }: Mesh) => Uint32Array.from(geometry.index?.array.slice(0, geometry.drawRange.count) ?? []);
    return { skin: of(this.faces.skin), cut: of(this.faces.cut), seam: this.seamEdges, materials: this.materials };
  }

  set style(style: Style) {
    for (const mesh of [this.faces.skin, this.faces.cut]) {
      mesh.material.wireframe = style === "wires";
      mesh.material.transparent = style === "elements";
      mesh.material.opacity = style === "elements" ? 0.45 : 1;
      mesh.material.needsUpdate = true;
      // Still hit by rays: tools are put down over the surface.
      mesh.material.visible = style !== "voxels" && style !== "links";
    }
    this.seam.material.visible = style !== "voxels" && style !== "links";
    this.edges.visible = showsElements(style);
    // Before voxels, whose colours they are not to hide.
    this.edges.material.opacity = style === "voxels" ? 0.25 : 0.55;
  }

  /** Takes a frame over; answers with the arrays that were shown before. */
  show({ shape, structure, nodes }: BodyFrame, nowS: number): SurfaceShape | undefined {
    const before = this.shape;
    const stands = !structure && before !== undefined && areSame(before.positions, shape.positions, 3 * this.vertexCount);
    this.looksNew = !stands || nowS < this.agedAtS;
    this.shape = shape;
    this.nowS.value = nowS;
    if (structure) this.restructure(structure, shape);
    const positions = this.faces.skin.geometry.getAttribute("position") as BufferAttribute;
    replace(positions, shape.positions);
    replace(this.faces.skin.geometry.getAttribute("normal") as BufferAttribute, shape.skinNormals);
    replace(this.faces.cut.geometry.getAttribute("normal") as BufferAttribute, shape.cutNormals);
    this.seam.show(shape.seam, nowS);
    if (nodes && this.edges.visible) this.showNodes(nodes);
    return before;
  }

  override dispose(): void {
    for (const { geometry, material } of [this.faces.skin, this.faces.cut, this.edges, this.seam]) {
      geometry.dispose();
      material.dispose();
    }
  }

  private restructure(structure: SurfaceStructure, shape: SurfaceShape): void {
    this.visible = true;
    this.cutAreaM2 = structure.cutAreaM2;
    this.vertexCount = structure.vertexCount;
    this.materials = structure.materials;
    this.seamEdges = structure.seam;
    const position = dynamic(shape.positions);
    const rest = new BufferAttribute(structure.rest, 3);
    const rim = new BufferAttribute(structure.rims, 2);
    const dress = (face: Face, index: Uint32Array, count: number, normals: Float32Array) => {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", position);
      geometry.setAttribute("rest", rest);
      geometry.setAttribute("rim", rim);
      geometry.setAttribute("normal", dynamic(normals));
      if (this.looks.length > 1) geometry.setAttribute("color", this.colors(face, structure));
      geometry.setIndex(new BufferAttribute(index, 1));
      geometry.setDrawRange(0, count);
      this.faces[face].geometry.dispose();
      this.faces[face].geometry = geometry;
    };
    dress("skin", structure.skin, structure.skinCount, shape.skinNormals);
    dress("cut", structure.cut, structure.cutCount, shape.cutNormals);
    if (structure.elementEdges) this.edges.geometry.setIndex(new BufferAttribute(structure.elementEdges, 1));
    const seam = this.seamDress(structure);
    this.agedAtS = AGED_S + seam.born.reduce((latest, bornS) => Math.max(latest, bornS), Number.NEGATIVE_INFINITY);
    this.seam.restructure(seam, shape.seam);
  }

  private seamDress({ seam, materials, rims }: SurfaceStructure): SeamDress {
    const count = seam.length / 2;
    const dress = { settled: new Float32Array(3 * count), fresh: new Float32Array(3 * count) };
    const palette = this.looks.map((look) => ({ settled: new Color(look.seam), fresh: new Color(look.fresh) }));
    for (let edge = 0; edge < count; edge++) {
      const { settled, fresh } = palette[materials[seam[2 * edge]]] ?? palette[0];
      settled.toArray(dress.settled, 3 * edge);
      fresh.toArray(dress.fresh, 3 * edge);
    }
    return { ...dress, born: Float32Array.from(seam, (vertex) => rims[2 * vertex + 1]) };
  }

  private colors(face: Face, { materials }: SurfaceStructure): BufferAttribute {
    const palette = this.looks.map((look) => new Color(look[face]));
    const colors = new Float32Array(3 * materials.length);
    materials.forEach((material, i) => (palette[material] ?? palette[0]).toArray(colors, 3 * i));
    return new BufferAttribute(colors, 3);
  }

  private showNodes(nodes: Float32Array): void {
    const index = this.edges.geometry.index;
    this.edges.geometry.dispose();
    this.edges.geometry = new BufferGeometry();
    this.edges.geometry.setAttribute("position", new BufferAttribute(nodes, 3));
    this.edges.geometry.setIndex(index);
  }
}

function areSame(a: Float32Array, b: Float32Array, count: number): boolean {
  for (let i = 0; i < count; i++) if (a[i] !== b[i]) return false;
  return true;
}

function dynamic(array: Float32Array): BufferAttribute {
  return new BufferAttribute(array, 3).setUsage(DynamicDrawUsage);
}

function replace(attribute: BufferAttribute, array: Float32Array): void {
  attribute.array = array;
  attribute.needsUpdate = true;
}
