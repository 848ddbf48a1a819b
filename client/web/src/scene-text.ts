// The text of a scene, as far as the page lets it be changed.

import { parse, stringify, type TomlTable } from "smol-toml";

/** A number that can be changed, and where it stands. */
export interface Setting {
  label: string;
  unit: string;
  /** Values the server takes. */
  least: number;
  most: number;
  value: number;
  set: (value: number) => void;
}

/** Settings that belong together: an object's, a tool's. */
export interface SettingGroup {
  title: string;
  settings: Setting[];
}

/** Length of the edge that tools are sized by where a scene has no blade, m. */
const ABSENT_BLADE_M = 0.06;
/** Radius of a probe in voxels: the server takes none of less than two. */
const PROBE_VOXELS = 2.1;

/** A scene whose numbers can be changed. */
export class SceneText {
  private readonly scene: TomlTable;

  constructor(toml: string) {
    this.scene = parse(toml);
  }

  toString(): string {
    return stringify(this.scene);
  }

  /** What can be changed. */
  get groups(): SettingGroup[] {
    const objects = tables(this.scene["objects"]).map((object) => this.objectGroup(object));
    const tools = tables(this.scene["tools"]).flatMap((tool) => this.toolGroup(tool));
    const rate = setting(this.scene, "rate_hz", "Steps a second", "Hz", 10, 4000, 1000);
    return [{ title: "Time", settings: [rate] }, ...objects, ...tools];
  }

  /** Adds a tool of each kind that the scene has none of, in the size of its blade: lifted, it costs nothing. */
  addMissingTools(): void {
    const tools = tables(this.scene["tools"]);
    const shapes = tools.map((tool) => tool["shape"] as TomlTable);
    const blade = shapes.map((shape) => shape["blade"] as TomlTable | undefined).find((found) => found);
    const sizeM = typeof blade?.["width_m"] === "number" ? blade["width_m"] : ABSENT_BLADE_M;
    const voxelsM = tables(this.scene["objects"]).map(({ voxel_size_m }) => Number(voxel_size_m ?? 0));
    const kinds: Record<string, TomlTable> = {
      blade: { width_m: sizeM, height_m: 0.8 * sizeM },
      scissors: { blade_length_m: 0.6 * sizeM, blade_height_m: 0.1 * sizeM },
      grasper: { radius_m: 0.12 * sizeM },
      probe: { radius_m: Math.max(0.1 * sizeM, PROBE_VOXELS * Math.max(0, ...voxelsM)) },
    };
    const names = new Set(tools.map(({ name }) => name));
    for (const [kind, shape] of Object.entries(kinds)) {
      if (shapes.some((other) => kind in other) || names.has(kind)) continue;
      tools.push({ name: kind, shape: { [kind]: shape } });
    }
    this.scene["tools"] = tools;
  }

  private objectGroup(object: TomlTable): SettingGroup {
    const material = object["material"] as TomlTable;
    const settings = [
      setting(material, "young_modulus_pa", "Stiffness", "Pa", 1e2, 1e10, 1e4),
      setting(material, "fracture_energy_j_per_m2", "Toughness", "J/m²", 1e-3, 1e6, 0),
      setting(material, "strain_stiffening", "Stiffening under strain", "", 0, 20, 0),
      setting(object, "level", "Level (0 exact, higher faster)", "", 0, 4, 2),
    ];
    return { title: object["name"] as string, settings };
  }

  private toolGroup(tool: TomlTable): SettingGroup[] {
    const blade = (tool["shape"] as TomlTable)["blade"] as TomlTable | undefined;
    if (!blade) return [];
    const settings = [
      setting(blade, "width_m", "Length of the edge", "m", 1e-3, 1, 0.06),
      setting(blade, "height_m", "Height", "m", 1e-3, 1, 0.05),
      setting(blade, "thickness_m", "Thickness", "m", 0, 0.05, 0),
      setting(blade, "flank_friction", "Friction of the flanks", "", 0, 2, 0),
    ];
    return [{ title: tool["name"] as string, settings }];
  }
}

function tables(value: unknown): TomlTable[] {
  return Array.isArray(value) ? (value as TomlTable[]) : [];
}

/** `absent` is what a scene without the number has. */
function setting(
  table: TomlTable,
  key: string,
  label: string,
  unit: string,
  least: number,
  most: number,
  absent: number,
): Setting {
  const stated = table[key];
  return {
    label,
    unit,
    least,
    most,
    value: typeof stated === "number" ? stated : absent,
    set: (value) => {
      // What is not stated and stays as it is goes on not being stated.
      if (stated !== undefined || value !== absent) table[key] = value;
    },
  };
}
