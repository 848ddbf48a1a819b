import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import { defineConfig, type Plugin } from "vite";

/** Beside each file of text its gzipped twin, which the server prefers. */
const packed: Plugin = {
  name: "packed",
  apply: "build",
  writeBundle({ dir }, bundle) {
    for (const name of [...Object.keys(bundle), "icon.svg"]) {
      const path = join(dir!, name);
      writeFileSync(`${path}.gz`, gzipSync(readFileSync(path), { level: 9 }));
    }
  },
};

// Names stay the same from build to build, so nothing old is left over, and browsers ask by the files' tags.
const names = { entryFileNames: "[name].js", chunkFileNames: "[name].js", assetFileNames: "[name][extname]" };

export default defineConfig({
  build: {
    outDir: "dist",
    emptyOutDir: false,
    assetsDir: "",
    target: "es2022",
    chunkSizeWarningLimit: 1000,
    modulePreload: { polyfill: false },
    rolldownOptions: { output: names },
  },
  worker: { format: "es", rolldownOptions: { output: names } },
  plugins: [packed],
  // `npm run dev` beside a server: calls go through to it.
  server: { proxy: { "^/kerf\\.v1\\.": process.env["SERVER"] ?? "http://127.0.0.1:50051" } },
  test: { include: ["test/**/*.test.ts"], benchmark: { include: ["test/**/*.bench.ts"] } },
} as Parameters<typeof defineConfig>[0]);
