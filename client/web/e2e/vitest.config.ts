import { defineConfig } from "vitest/config";

export default defineConfig({
  test: { include: ["e2e/**/*.browser.ts"], testTimeout: 180_000, hookTimeout: 40_000, fileParallelism: false },
});
