// Flesh: a wet film over an uneven, mottled body that glows where it turns away from the eye. The unevenness is
// computed where the material was at rest, so that it stretches and moves with the tissue.

import { Color, DoubleSide, MeshPhysicalMaterial } from "three";
import type { Look } from "./looks";

const NOISE = /* glsl */ `
float hash31(vec3 p) {
  p = fract(p * 0.1031);
  p += dot(p, p.zyx + 31.32);
  return fract((p.x + p.y) * p.z);
}
float valueNoise(vec3 p) {
  vec3 i = floor(p);
  vec3 f = fract(p);
  f = f * f * (3.0 - 2.0 * f);
  return mix(
    mix(mix(hash31(i), hash31(i + vec3(1, 0, 0)), f.x), mix(hash31(i + vec3(0, 1, 0)), hash31(i + vec3(1, 1, 0)), f.x), f.y),
    mix(mix(hash31(i + vec3(0, 0, 1)), hash31(i + vec3(1, 0, 1)), f.x), mix(hash31(i + vec3(0, 1, 1)), hash31(i + vec3(1, 1, 1)), f.x), f.y),
    f.z);
}
float layeredNoise(vec3 p) {
  return 0.55 * valueNoise(p) + 0.3 * valueNoise(p * 2.3 + 7.0) + 0.15 * valueNoise(p * 5.1 + 3.0);
}
`;

/** Makes the material of one kind of face. `detailPerM` says how many blotches there are on a metre. */
export function tissueMaterial(look: Look, face: "skin" | "cut", detailPerM: number): MeshPhysicalMaterial {
  const isCut = face === "cut";
  const material = new MeshPhysicalMaterial({
    color: isCut ? look.cut : look.skin,
    roughness: look.roughness + (isCut ? 0.08 : 0),
    clearcoat: look.wetness,
    clearcoatRoughness: isCut ? 0.3 : 0.22,
    specularIntensity: 0.6,
    side: DoubleSide,
  });
  const uniforms = {
    detailPerM: { value: isCut ? 1.7 * detailPerM : detailPerM },
    mottle: { value: look.mottle },
    relief: { value: (isCut ? 1.6 : 1) * look.relief },
    glow: { value: new Color(look.glow) },
  };
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", "#include <common>\nattribute vec3 rest;\nvarying vec3 vRest;")
      .replace("#include <begin_vertex>", "#include <begin_vertex>\nvRest = rest;");
    shader.fragmentShader = shader.fragmentShader
      .replace(
        "#include <common>",
        `#include <common>
        varying vec3 vRest;
        uniform float detailPerM, mottle, relief;
        uniform vec3 glow;
        ${NOISE}`,
      )
      .replace(
        "#include <color_fragment>",
        `#include <color_fragment>
        float blotches = layeredNoise(vRest * detailPerM);
        float grain = valueNoise(vRest * detailPerM * 6.0);
        diffuseColor.rgb *= 1.0 + mottle * (1.1 * (blotches - 0.5) + 0.25 * (grain - 0.5));`,
      )
      .replace(
        "#include <roughnessmap_fragment>",
        `#include <roughnessmap_fragment>
        roughnessFactor = clamp(roughnessFactor + 0.3 * (blotches - 0.5), 0.08, 1.0);`,
      )
      .replace(
        "#include <normal_fragment_maps>",
        `#include <normal_fragment_maps>
        {
          vec3 alongX = dFdx(-vViewPosition), alongY = dFdy(-vViewPosition);
          float height = relief * 0.06 / detailPerM * (blotches + 0.25 * grain);
          vec3 acrossX = cross(alongY, normal), acrossY = cross(normal, alongX);
          float determinant = dot(alongX, acrossX) * faceDirection;
          vec3 slope = sign(determinant) * (dFdx(height) * acrossX + dFdy(height) * acrossY);
          normal = normalize(abs(determinant) * normal - slope);
        }`,
      )
      .replace(
        "#include <emissivemap_fragment>",
        `#include <emissivemap_fragment>
        float turnedAway = 1.0 - clamp(dot(normal, normalize(vViewPosition)), 0.0, 1.0);
        totalEmissiveRadiance += glow * diffuseColor.rgb * (0.05 + 0.35 * turnedAway * turnedAway * turnedAway);`,
      );
  };
  return material;
}
