// Flesh: a wet film over a mottled body that glows where it turns away from the eye. The blotches are computed where
// the material was at rest, so that they stretch and move with the tissue.

import { Color, DoubleSide, MeshPhysicalMaterial } from "three";
import type { Look } from "./looks";
import { AGEING } from "./seam-line";

const NOISE = /* glsl */ `
vec3 gradientAt(vec3 p) {
  p = fract(p * vec3(0.1031, 0.103, 0.0973));
  p += dot(p, p.yxz + 33.33);
  return 2.0 * fract((p.xxy + p.yxx) * p.zyx) - 1.0;
}
// Smooth, between -1 and 1.
float noise(vec3 p) {
  vec3 i = floor(p), f = fract(p);
  vec3 u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
  float sum = 0.0;
  for (int corner = 0; corner < 8; corner++) {
    vec3 c = vec3(corner & 1, (corner >> 1) & 1, corner >> 2);
    vec3 share = mix(1.0 - u, u, c);
    sum += share.x * share.y * share.z * dot(gradientAt(i + c), f - c);
  }
  return sum;
}
// Turns the lattice of one layer against that of the next.
const mat3 ACROSS = mat3(0.0, 0.8, 0.6, -0.8, 0.36, -0.48, -0.6, -0.48, 0.64);
`;

/**
 * Makes the material of one kind of face. `detailPerM` says how many blotches there are on a metre, `nowS` the sim time,
 * by which rims of cuts are new or old.
 */
export function tissueMaterial(
  look: Look,
  face: "skin" | "cut",
  detailPerM: number,
  nowS: { value: number },
): MeshPhysicalMaterial {
  const isCut = face === "cut";
  const material = new MeshPhysicalMaterial({
    color: isCut ? look.cut : look.skin,
    roughness: look.roughness + (isCut ? 0.08 : 0),
    clearcoat: look.wetness,
    clearcoatRoughness: isCut ? 0.36 : 0.3,
    specularIntensity: 0.6,
    side: DoubleSide,
  });
  const uniforms = {
    detailPerM: { value: isCut ? 1.7 * detailPerM : detailPerM },
    mottle: { value: look.mottle },
    glow: { value: new Color(look.glow) },
    fresh: { value: new Color(look.fresh) },
    // Linear: how much of each colour is left beside a seam.
    stain: { value: new Color(look.stain) },
    nowS,
  };
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>
        attribute vec3 rest;
        attribute vec2 rim;
        uniform float nowS;
        varying vec3 vRest;
        varying vec2 vRim;
        ${AGEING}`)
      .replace(
        "#include <begin_vertex>",
        `#include <begin_vertex>
        vRest = rest;
        float ageS = nowS - rim.y;
        vRim = rim.x * vec2(spread(ageS), freshness(ageS));`,
      );
    shader.fragmentShader = shader.fragmentShader
      .replace(
        "#include <common>",
        `#include <common>
        varying vec3 vRest;
        varying vec2 vRim;
        uniform float detailPerM, mottle;
        uniform vec3 glow, fresh, stain;
        ${NOISE}`,
      )
      .replace(
        "#include <color_fragment>",
        `#include <color_fragment>
        vec3 place = ACROSS * vRest * detailPerM;
        float blotches = noise(place) + 0.45 * noise(ACROSS * place * 4.0);
        diffuseColor.rgb *= exp(0.8 * mottle * blotches);
        // Not in an even band: it runs along the blotches.
        vec2 rim = clamp(vRim * (1.0 + 0.5 * blotches), 0.0, 1.0);
        diffuseColor.rgb *= mix(vec3(1.0), stain, rim.x);
        diffuseColor.rgb = mix(diffuseColor.rgb, fresh, 0.75 * rim.y);`,
      )
      .replace(
        "#include <roughnessmap_fragment>",
        `#include <roughnessmap_fragment>
        roughnessFactor = clamp((roughnessFactor + 0.25 * blotches) * (1.0 - 0.6 * rim.x), 0.08, 1.0);`,
      )
      .replace(
        "#include <emissivemap_fragment>",
        `#include <emissivemap_fragment>
        float turnedAway = 1.0 - clamp(dot(normal, normalize(vViewPosition)), 0.0, 1.0);
        totalEmissiveRadiance += glow * diffuseColor.rgb * (0.03 + 0.3 * turnedAway * turnedAway * turnedAway);`,
      );
  };
  return material;
}
