// A scene of one's own: its text, and the files that it refers to, as they are chosen together.

import { parse } from "smol-toml";

/** Endings of the files that can be chosen: scenes, meshes, label maps and edges. */
export const ENDINGS = ".toml,.stl,.obj,.ply,.vtu,.vtp,.msh,.nii,.nii.gz,.nrrd,.csv";

/** What is sent of a file: its name as the scene's text has it. */
export interface NamedFile<F> {
  name: string;
  file: F;
}

/**
 * The one scene among some files, and those of the others that its text, read by `read`, refers to. A page gets to know of
 * a file's name and not of its folder: `meshes/organ.stl` is the file `organ.stl`.
 */
export async function ownScene<F extends { name: string }>(
  chosen: readonly F[],
  read: (file: F) => Promise<string>,
): Promise<{ toml: string; files: NamedFile<F>[] }> {
  const scenes = chosen.filter(({ name }) => name.endsWith(".toml"));
  if (scenes.length !== 1) {
    throw new Error(`Choose one scene (.toml) together with its files; ${scenes.length} were chosen.`);
  }
  const toml = await read(scenes[0]);
  const named = [...new Set(filesOf(parsed(toml)))];
  const files = named.map((name) => ({ name, file: chosen.find((file) => file.name === baseName(name)) }));
  const missing = files.filter(({ file }) => file === undefined).map(({ name }) => baseName(name));
  if (missing.length > 0) throw new Error(`The scene refers to ${missing.join(", ")}: choose the scene and its files together.`);
  return { toml, files: files as NamedFile<F>[] };
}

/** What is wrong with the text the server says best, with its line. */
function parsed(toml: string): unknown {
  try {
    return parse(toml);
  } catch {
    return {};
  }
}

function baseName(path: string): string {
  return path.slice(path.lastIndexOf("/") + 1);
}

/** Every text that is called `file`, wherever it stands. */
function filesOf(value: unknown): string[] {
  if (typeof value !== "object" || value === null) return [];
  return Object.entries(value).flatMap(([key, inner]: [string, unknown]) =>
    key === "file" && typeof inner === "string" ? [inner] : filesOf(inner),
  );
}
