// Files of a scene, sent in parts: a browser cannot send a stream.

import type { NamedFile } from "../own-scene";
import { sessions } from "./server";

/** As the protocol advises. */
const PART_BYTES = 256 << 10;

/** Sends files and tells how far it is; the name of the upload, empty where there are no files. */
export async function sendFiles(
  files: readonly NamedFile<Blob>[],
  onProgress: (sentBytes: number, totalBytes: number) => void,
): Promise<string> {
  const totalBytes = files.reduce((sum, { file }) => sum + file.size, 0);
  let uploadId = "";
  for (const { name, file } of files) {
    // An empty file is sent too: the server says what is wrong with it.
    for (let start = 0; start === 0 || start < file.size; start += PART_BYTES) {
      const data = new Uint8Array(await file.slice(start, start + PART_BYTES).arrayBuffer());
      const answer = await sessions.sendSceneFile({ uploadId, fileName: start === 0 ? name : "", data });
      uploadId = answer.uploadId;
      onProgress(Number(answer.receivedBytes), totalBytes);
    }
  }
  return uploadId;
}
