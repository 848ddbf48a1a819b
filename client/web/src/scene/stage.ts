// What everything is drawn on: canvas, camera, light, and the table under the tissue.

import {
  ACESFilmicToneMapping,
  type Box3,
  BoxGeometry,
  CanvasTexture,
  CircleGeometry,
  Color,
  DirectionalLight,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  PCFShadowMap,
  PerspectiveCamera,
  PMREMGenerator,
  Scene,
  SRGBColorSpace,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { ViewPoint } from "../view-link";
import { Quality } from "./quality";

const FIELD_OF_VIEW_DEG = 30;
/** Pixels of the screen that are drawn for one of the page, at most: more cannot be told apart. */
const MAX_PIXEL_RATIO = 2;

/** On a page wider than this, px, what is looked at stands this far, px, to the left of the middle. */
const WIDE_PX = 760;
const ASIDE_PX = 105;

export interface Backdrop {
  middle: string;
  rim: string;
  table: string;
}

/** Whether the browser can draw at all. */
export function canDraw(): boolean {
  return document.createElement("canvas").getContext("webgl2") !== null;
}

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.005, 20);
  readonly controls: OrbitControls;
  readonly canvas: HTMLCanvasElement;
  private readonly renderer: WebGLRenderer;
  private readonly sun = new DirectionalLight(0xfff2e4, 2.6);
  private readonly table: Mesh<CircleGeometry, MeshStandardMaterial>;
  private readonly quality = new Quality();
  private isStale = true;

  constructor(canvas: HTMLCanvasElement) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "high-performance" });
    // Asking for a shader's log waits for its compiler, 1.6 s at the start on a slow machine.
    this.renderer.debug.checkShaderErrors = import.meta.env.DEV;
    this.renderer.toneMapping = ACESFilmicToneMapping;
    this.renderer.toneMappingExposure = 1.05;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.scene.environment = studio(this.renderer);
    this.scene.environmentIntensity = 1.1;
    this.table = table();
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    this.sun.shadow.radius = 5;
    this.scene.add(this.table, this.sun, this.sun.target);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.maxPolarAngle = 0.52 * Math.PI;
    this.controls.addEventListener("change", () => this.invalidate());
    new ResizeObserver(() => this.resize()).observe(canvas);
  }

  /** Something is not where it was: the next picture has to be drawn. */
  invalidate(): void {
    this.isStale = true;
  }

  set backdrop({ middle, rim, table }: Backdrop) {
    this.scene.background = vignette(middle, rim);
    this.table.material.color = new Color(table);
    this.invalidate();
  }

  /** Puts camera, light and table where they suit the box. */
  frame(box: Box3): void {
    const center = box.getCenter(new Vector3());
    const sizeM = box.getSize(new Vector3()).length();
    const { camera, controls, sun } = this;
    // A little above the middle, where tools come from.
    controls.target.copy(center).setY(center.y + 0.06 * sizeM);
    controls.minDistance = 0.3 * sizeM;
    controls.maxDistance = 6 * sizeM;
    // A narrow window sees less to the sides, so the eye goes back.
    const distanceM = 2 * sizeM * Math.max(1, 1.15 / camera.aspect);
    camera.position.copy(controls.target).addScaledVector(new Vector3(0.38, 0.4, 1).normalize(), distanceM);
    camera.near = 0.02 * sizeM;
    camera.far = 30 * sizeM;
    camera.updateProjectionMatrix();
    this.table.position.set(center.x, box.min.y - 0.001 * sizeM, center.z);
    this.table.scale.setScalar(2.6 * sizeM);
    sun.position.copy(center).add(new Vector3(-0.5, 1.3, 0.55).multiplyScalar(sizeM));
    sun.target.position.copy(center);
    const reachM = 0.95 * sizeM;
    Object.assign(sun.shadow.camera, { left: -reachM, right: reachM, top: reachM, bottom: -reachM });
    Object.assign(sun.shadow.camera, { near: 0.05 * sizeM, far: 4 * sizeM });
    sun.shadow.camera.updateProjectionMatrix();
    sun.shadow.normalBias = 0.004 * sizeM;
    sun.shadow.bias = -0.0004;
    controls.update();
    this.quality.restart();
    this.invalidate();
  }

  get viewPoint(): ViewPoint {
    return { eye: this.camera.position.clone(), target: this.controls.target.clone() };
  }

  /** Looks from there, as near or far as the scene in the frame lets one. */
  look({ eye, target }: ViewPoint): void {
    this.controls.target.copy(target);
    this.camera.position.copy(eye);
    this.controls.update();
    this.invalidate();
  }

  /** Draws if anything has changed since the last picture, or stands still that was drawn in haste. */
  draw(now: number): void {
    this.controls.update();
    if (this.isStale) this.render(this.quality.moving(now));
    else if (this.quality.standsStill(now)) this.render(1);
    this.isStale = false;
  }

  /** The picture as it is now. */
  picture(): Promise<Blob | null> {
    this.render(1);
    return new Promise((resolve) => this.canvas.toBlob(resolve, "image/png"));
  }

  /** `fineness` is a share of the screen's. */
  private render(fineness: number): void {
    const ratio = fineness * Math.min(devicePixelRatio, MAX_PIXEL_RATIO);
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    // A machine that slow leaves shadows where they were until things stand still.
    this.renderer.shadowMap.autoUpdate = fineness > 0.5;
    this.renderer.render(this.scene, this.camera);
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    // The middle of what the panels leave free.
    const asidePx = clientWidth > WIDE_PX ? ASIDE_PX : 0;
    this.camera.setViewOffset(clientWidth, clientHeight, asidePx, 0, clientWidth, clientHeight);
    this.camera.updateProjectionMatrix();
    this.invalidate();
  }
}

/** Light of a dark room with soft boxes, which wet surfaces mirror. */
function studio(renderer: WebGLRenderer) {
  const room = new Scene();
  room.background = new Color(0x2c3036);
  const box = (color: number, strength: number, size: [number, number, number], at: [number, number, number]) => {
    const material = new MeshBasicMaterial({ color: new Color(color).multiplyScalar(strength) });
    const mesh = new Mesh(new BoxGeometry(...size), material);
    mesh.position.set(...at);
    mesh.lookAt(0, 0, 0);
    room.add(mesh);
  };
  box(0xfff4e6, 9, [3.4, 1.6, 0.05], [-2.5, 4, 2]);
  box(0xdce8ff, 5, [1.6, 3.4, 0.05], [4.5, 1.6, 1]);
  box(0xd0e0ff, 2.4, [1.6, 3, 0.05], [-4.5, 1.2, -0.5]);
  box(0xffe6d0, 3.5, [4, 0.7, 0.05], [0, 2.2, -4.5]);
  box(0xe8eeff, 1.2, [6, 6, 0.05], [0, 6, 0]);
  box(0x6a4038, 0.6, [8, 8, 0.05], [0, -3, 0]);
  const generator = new PMREMGenerator(renderer);
  // The library takes no less than 256 pixels, for which a machine without a graphics card works for five seconds. Of soft
  // boxes 64 show the same, to six of 255 shades.
  Object.assign(generator, { _setSize: () => Object.assign(generator, { _cubeSize: 64 }) });
  const texture = generator.fromScene(room, 0.06).texture;
  generator.dispose();
  return texture;
}

function table(): Mesh<CircleGeometry, MeshStandardMaterial> {
  const fade = drawn(256, (context) => {
    const gradient = context.createRadialGradient(128, 128, 0, 128, 128, 128);
    gradient.addColorStop(0.2, "#fff");
    gradient.addColorStop(0.6, "#777");
    gradient.addColorStop(1, "#000");
    return gradient;
  });
  const material = new MeshStandardMaterial({ roughness: 0.85, transparent: true, alphaMap: fade, depthWrite: false });
  const mesh = new Mesh(new CircleGeometry(1, 64), material);
  mesh.rotation.x = -Math.PI / 2;
  mesh.receiveShadow = true;
  mesh.renderOrder = -1;
  return mesh;
}

function vignette(middle: string, rim: string): CanvasTexture {
  const texture = drawn(512, (context) => {
    const gradient = context.createRadialGradient(256, 210, 20, 256, 256, 370);
    gradient.addColorStop(0, middle);
    gradient.addColorStop(1, rim);
    return gradient;
  });
  texture.colorSpace = SRGBColorSpace;
  return texture;
}

function drawn(size: number, gradient: (context: CanvasRenderingContext2D) => CanvasGradient): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = size;
  const context = canvas.getContext("2d")!;
  context.fillStyle = gradient(context);
  context.fillRect(0, 0, size, size);
  return new CanvasTexture(canvas);
}
