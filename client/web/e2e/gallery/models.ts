// What is cut at will: a bear, and an apple and a cucumber of the built-in materials in shapes of their own. A grasper
// holds what is cut off and takes it away.

import type { TomlTable } from "smol-toml";
import { ACROSS, type Place, type Scene, turned } from "./lockstep";
import type { Look } from "./sheet";

interface Model {
  label: string;
  scene: Scene;
  look: Look;
  /** Where the grasper closes, and where it goes with what was cut off, m. */
  grasp: Place["at"];
  pull: Place["at"];
  cut: { from: Place; to: Place };
}

/** A cut that leans to the right by so many degrees: across the screen, and open to whoever looks. */
const leaning = (degrees: number) => turned([0, 0, 1], degrees).multiply(ACROSS);

/** A cut along a direction through a point, from `before` m above it to `after` m below. */
function cut(through: Place["at"], degrees: number, before: number, after: number): { from: Place; to: Place } {
  const lean = (degrees * Math.PI) / 180;
  const [dx, dy] = [Math.sin(lean), -Math.cos(lean)];
  const [x, y, z] = through;
  const at = (way: number): Place => ({ at: [x + way * dx, y + way * dy, z], turn: leaning(degrees) });
  return { from: at(-before), to: at(after) };
}

function addGrasper(scene: TomlTable, radius_m: number): void {
  (scene["tools"] as TomlTable[]).push({ name: "grasper", shape: { grasper: { radius_m } } });
}

/** The material of a scene in another shape, held where a box is. */
function reshape(scene: TomlTable, shape: TomlTable, box: TomlTable): void {
  const [object] = scene["objects"] as TomlTable[];
  object["shape"] = shape;
  object["fixed"] = [{ box }];
  object["voxel_size_m"] = 0.002;
  object["level"] = 1;
  delete scene["tracked_points"];
}

export const MODELS: readonly Model[] = [
  {
    label: "gummy bear",
    scene: { name: "gummy-bear", stepRateHz: 500, change: (scene) => addGrasper(scene, 0.004) },
    look: { eye: [0.045, 0.075, 0.15], at: [0.002, 0.033, 0] },
    grasp: [0.0125, 0.056, -0.004],
    pull: [0.025, 0.064, -0.002],
    cut: cut([0.004, 0.047, -0.002], 40, 0.02, 0.026),
  },
  {
    label: "apple",
    scene: {
      name: "apple",
      stepRateHz: 500,
      change: (scene) => {
        const shape = { ellipsoid: { center_m: [0, 0.029, 0], semi_axes_m: [0.033, 0.029, 0.033] } };
        reshape(scene, shape, { min_m: [-1, -1, -1], max_m: [1, 0.006, 1] });
        addGrasper(scene, 0.006);
      },
    },
    look: { eye: [0.07, 0.1, 0.17], at: [0.006, 0.029, 0] },
    grasp: [0.023, 0.046, 0],
    pull: [0.043, 0.054, 0.004],
    cut: cut([0.008, 0.035, 0], 30, 0.04, 0.05),
  },
  {
    label: "cucumber",
    scene: {
      name: "cucumber",
      stepRateHz: 500,
      change: (scene) => {
        const shape = { capsule: { from_m: [-0.04, 0.016, 0], to_m: [0.04, 0.016, 0], radius_m: 0.015 } };
        reshape(scene, shape, { min_m: [-1, -1, -1], max_m: [0, 0.006, 1] });
        addGrasper(scene, 0.006);
      },
    },
    look: { eye: [0.1, 0.09, 0.18], at: [0.006, 0.017, 0] },
    grasp: [0.044, 0.02, 0],
    pull: [0.066, 0.026, 0.006],
    cut: cut([0.018, 0.016, 0], 8, 0.022, 0.02),
  },
];
