// What things look like: by the colour that the scene states, else by words in the name of a material.

import { Color } from "three";

/** How the surface of a material and the walls of a cut in it look; colours as sRGB. */
export interface Look {
  skin: number;
  cut: number;
  /** What shines through from within, seen where the surface turns away. */
  glow: number;
  roughness: number;
  /** Strength of the wet film. */
  wetness: number;
  /** How much the colour varies from place to place, 0 to 1. */
  mottle: number;
  /** The line where a cut meets the skin: while it is new, and when it has settled. */
  fresh: number;
  seam: number;
  /** What is left of the colours beside it. */
  stain: number;
}

const FLESH: Look = {
  skin: 0x7d332a,
  cut: 0xd0695a,
  glow: 0xff6a4a,
  roughness: 0.5,
  wetness: 0.6,
  mottle: 0.75,
  fresh: 0xc20f16,
  seam: 0x2b0406,
  stain: 0xb07070,
};

/** What does not bleed: its juice darkens it, and that is all. */
function dry(seam: number): Pick<Look, "fresh" | "seam" | "stain"> {
  return { fresh: seam, seam, stain: 0xd0c8c0 };
}

const LOOKS: readonly (readonly [RegExp, Partial<Look>])[] = [
  [/parenchyma/i, { cut: 0xa9473b }],
  [/vein|artery|vessel/i, { skin: 0x4a3a5e, cut: 0x4a0d1a, glow: 0x8a2030, mottle: 0.2 }],
  [/lesion|tumou?r/i, { skin: 0xc9a27a, cut: 0xe0c49a, glow: 0xffd9a0, mottle: 0.7 }],
  [/kidney/i, { skin: 0x76302c, cut: 0xb65a4c }],
  [/skin|dermis/i, { skin: 0xd9a688, cut: 0xd0564c, glow: 0xff8c6a, roughness: 0.6, wetness: 0.15, mottle: 0.25 }],
  [/fat/i, { skin: 0xe3c27a, cut: 0xf0d494, glow: 0xffe2a8, wetness: 0.5, mottle: 0.3 }],
  [/bear|gumm/i, { skin: 0xb8232f, cut: 0xd94a50, glow: 0xff4040, roughness: 0.3, wetness: 0.6, mottle: 0.08, ...dry(0x4a0810) }],
  [/jelly|gelatine/i, { skin: 0xd98a1f, cut: 0xf0ae4a, glow: 0xffb640, roughness: 0.22, wetness: 0.9, mottle: 0.08, ...dry(0x6b3a06) }],
  [/tofu/i, { skin: 0xe9e2d0, cut: 0xf6f1e4, glow: 0xfff4dc, roughness: 0.6, wetness: 0.35, mottle: 0.12, ...dry(0x6f6650) }],
  [/rubber/i, { skin: 0x4e5763, cut: 0x8794a4, glow: 0x607080, roughness: 0.75, wetness: 0.05, mottle: 0.1, ...dry(0x14181d) }],
  [/potato/i, { skin: 0x9a744a, cut: 0xeed9a2, glow: 0xffe6b0, roughness: 0.75, wetness: 0.12, mottle: 0.7, ...dry(0x4a3418) }],
  [/cucumber/i, { skin: 0x39602f, cut: 0xcfe3b0, glow: 0xc8f0a0, roughness: 0.45, wetness: 0.5, mottle: 0.6, ...dry(0x12240d) }],
  [/apple/i, { skin: 0xa62630, cut: 0xf2e6c4, glow: 0xffe0b0, roughness: 0.32, wetness: 0.5, mottle: 0.5, ...dry(0x40100c) }],
  [/cuboid|block/i, { skin: 0x96403a, cut: 0xe08a72, mottle: 0.35 }],
];

/** Colours of materials that have no look of their own, after an object's first. */
const OTHERS = [0xc9a27a, 0x9a6fb0, 0x5f8fb0, 0x7fa35c, 0xd08a4e];

/** How much of the way to white a cut face is where the scene states a colour. */
const CUT_PALENESS = 0.35;
/** How much of a stated colour is left in the seam of what does not bleed; linear. */
const SEAM_DARKNESS = 0.08;

/** The look of an object's material, by its name, its place among the object's materials, and its "#rrggbb", if any. */
export function lookOf(name: string, index: number, stated = ""): Look {
  const known = LOOKS.find(([words]) => words.test(name))?.[1];
  const found = { ...FLESH, ...known };
  if (stated) {
    const skin = new Color(stated);
    const cut = skin.clone().lerp(new Color(0xffffff), CUT_PALENESS);
    const seam = skin.clone().multiplyScalar(SEAM_DARKNESS).getHex();
    const line = found.fresh === FLESH.fresh ? {} : dry(seam);
    return { ...found, skin: skin.getHex(), cut: cut.getHex(), glow: cut.getHex(), ...line };
  }
  if (index === 0 || known) return found;
  const color = OTHERS[(index - 1) % OTHERS.length];
  return { ...found, skin: color, cut: color };
}
