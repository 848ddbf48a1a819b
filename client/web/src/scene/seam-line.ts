// The line along which the wall of a cut meets the skin, as wide on the screen as it is there, but never too thin to be
// seen. Where it is new it is thin and bright, and widens and darkens as blood does.

import {
  BufferAttribute,
  DynamicDrawUsage,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
  Mesh,
  ShaderMaterial,
  Vector2,
  Vector4,
  type WebGLRenderer,
} from "three";

/** Width in sizes of the object, and the least and most of it in pixels of the page. */
const WIDTH = 0.005;
const LEAST_PX = 1.8;
const MOST_PX = 6;
/** The line stands out from the surface by so much of the object's size: the surface curves away between vertices. */
const RAISED = 0.004;

/** How much of what is new there is left, and how far it has spread, after some time. */
export const AGEING = /* glsl */ `
float freshness(float ageS) { return exp(-max(ageS, 0.0) / 2.5); }
float spread(float ageS) { return 1.0 - exp(-max(ageS, 0.0) / 0.6); }
`;
/** After this time both are what they will be, to the steps of a screen's colours, s. */
export const AGED_S = 14;

const VERTEX = /* glsl */ `
attribute vec3 from, to, settled, fresh;
attribute vec2 born;
uniform vec2 viewport;
uniform float nowS, widthM, leastPx, mostPx, raisedM;
varying vec3 vColor;
varying vec2 vPlace;
varying float vLengthPx, vHalfPx;
${AGEING}
vec4 raised(vec3 at) {
  vec4 seen = modelViewMatrix * vec4(at, 1.0);
  // Towards the eye.
  seen.xyz *= max(0.0, 1.0 - raisedM / length(seen.xyz));
  return seen;
}
void main() {
  vec4 a = raised(from), b = raised(to);
  vec4 clipA = projectionMatrix * a, clipB = projectionMatrix * b;
  // What is behind the eye has no place on the screen.
  bool isBehind = clipA.w <= 0.0 || clipB.w <= 0.0;
  vec2 pxA = 0.5 * viewport * clipA.xy / clipA.w, pxB = 0.5 * viewport * clipB.xy / clipB.w;
  float lengthPx = length(pxB - pxA);
  vec2 along = lengthPx > 1e-3 ? (pxB - pxA) / lengthPx : vec2(1.0, 0.0);
  float ageS = nowS - (position.x < 0.5 ? born.x : born.y);
  float distanceM = -mix(a.z, b.z, position.x);
  float seenPx = 0.5 * viewport.y * projectionMatrix[1][1] * widthM / max(distanceM, 1e-6);
  vHalfPx = 0.5 * max(leastPx, min(mostPx, seenPx) * mix(0.4, 1.0, spread(ageS)));
  // One pixel more, over which the line fades.
  float reachPx = vHalfPx + 1.0;
  vPlace = vec2(mix(-reachPx, lengthPx + reachPx, position.x), position.y * reachPx);
  vLengthPx = lengthPx;
  vColor = mix(settled, fresh, freshness(ageS));
  vec4 clip = position.x < 0.5 ? clipA : clipB;
  vec2 asidePx = along * (position.x < 0.5 ? -reachPx : reachPx) + vec2(-along.y, along.x) * vPlace.y;
  clip.xy += 2.0 * asidePx / viewport * clip.w;
  gl_Position = isBehind ? vec4(2.0, 2.0, 2.0, 1.0) : clip;
}
`;

const FRAGMENT = /* glsl */ `
varying vec3 vColor;
varying vec2 vPlace;
varying float vLengthPx, vHalfPx;
void main() {
  // Round ends, so that one edge goes over into the next.
  float past = vPlace.x - clamp(vPlace.x, 0.0, vLengthPx);
  float coverage = clamp(vHalfPx + 0.5 - length(vec2(past, vPlace.y)), 0.0, 1.0);
  if (coverage <= 0.0) discard;
  gl_FragColor = vec4(vColor, coverage);
  #include <tonemapping_fragment>
  #include <colorspace_fragment>
}
`;

/** What an edge of the seam is drawn by: linear colours, three numbers an edge, and since when, two. */
export interface SeamDress {
  settled: Float32Array;
  fresh: Float32Array;
  born: Float32Array;
}

export class SeamLine extends Mesh<InstancedBufferGeometry, ShaderMaterial> {
  private readonly size = new Vector2();
  private readonly drawn = new Vector4();

  constructor(sizeM: number) {
    const material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: {
        viewport: { value: new Vector2(1, 1) },
        nowS: { value: 0 },
        widthM: { value: WIDTH * sizeM },
        leastPx: { value: LEAST_PX },
        mostPx: { value: MOST_PX },
        raisedM: { value: RAISED * sizeM },
      },
      transparent: true,
      depthWrite: false,
    });
    super(new InstancedBufferGeometry(), material);
    this.frustumCulled = false;
    // Nobody picks it, and it hides nothing from the light.
    this.raycast = () => {};
  }

  /** Other edges than before. */
  restructure({ settled, fresh, born }: SeamDress, ends: Float32Array): void {
    this.geometry.dispose();
    const geometry = new InstancedBufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(Float32Array.of(0, -1, 0, 1, -1, 0, 1, 1, 0, 0, 1, 0), 3));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const places = new InstancedInterleavedBuffer(ends, 6).setUsage(DynamicDrawUsage);
    geometry.setAttribute("from", new InterleavedBufferAttribute(places, 3, 0));
    geometry.setAttribute("to", new InterleavedBufferAttribute(places, 3, 3));
    geometry.setAttribute("settled", new InstancedBufferAttribute(settled, 3));
    geometry.setAttribute("fresh", new InstancedBufferAttribute(fresh, 3));
    geometry.setAttribute("born", new InstancedBufferAttribute(born, 2));
    geometry.instanceCount = ends.length / 6;
    this.geometry = geometry;
    this.visible = ends.length > 0;
  }

  /** Where the ends of the edges are now, m. */
  show(ends: Float32Array, nowS: number): void {
    this.material.uniforms["nowS"].value = nowS;
    if (!this.visible) return;
    const { data } = this.geometry.getAttribute("from") as InterleavedBufferAttribute;
    data.array = ends;
    data.needsUpdate = true;
  }

  override onBeforeRender = (renderer: WebGLRenderer): void => {
    const { uniforms } = this.material;
    const drawn = renderer.getCurrentViewport(this.drawn);
    (uniforms["viewport"].value as Vector2).set(drawn.z, drawn.w);
    // A picture that is drawn coarsely has fewer pixels than the page: a line is still no thinner than one and a half.
    const ratio = drawn.w / Math.max(1, renderer.getSize(this.size).y);
    uniforms["leastPx"].value = Math.max(1.5, LEAST_PX * ratio);
    uniforms["mostPx"].value = MOST_PX * ratio;
  };
}
