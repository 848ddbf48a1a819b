import { defineConfig } from "vitest/config";

export default defineConfig({
  test: {
    include: ["e2e/**/*.browser.ts"],
    testTimeout: 180_000,
    hookTimeout: 40_000,
    fileParallelism: false,
    // A busy machine takes seconds for a picture.
    expect: { poll: { timeout: 30_000 } },
  },
});
