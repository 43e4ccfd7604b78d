/**
 * Build the pages' scripts from `src/` into the Python package, always to the same bytes.
 *
 *   npm install && npm run build
 *
 * The banner names the sources by their sha256, so that a test can tell whether a file is theirs
 * (`tests/report/test_replay_build.py` computes the same digest).
 */
import { createHash } from "node:crypto";
import { copyFileSync, readFileSync, readdirSync } from "node:fs";
import { join, relative, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const OUT = process.argv[2] ?? "../dronecombat_jax/report/viewer";
const HERE = new URL(".", import.meta.url);
const FOLDER = fileURLToPath(HERE);

const ENTRIES = { replay: "src/main.js", play: "src/play/main.js" };

/** sha256 in hex over names and bytes of what the scripts are made from, in order of name. */
export function digest() {
  const everything = readdirSync(new URL("src/", HERE), { recursive: true, withFileTypes: true });
  const files = everything.filter((entry) => entry.isFile());
  const sources = files.map(({ parentPath, name }) =>
    relative(FOLDER, join(parentPath, name)).replaceAll("\\", "/"),
  );
  const hash = createHash("sha256");
  for (const name of ["build.mjs", "package.json", ...sources].sort()) {
    const bytes = readFileSync(new URL(name, HERE));
    hash.update(`${name} ${bytes.length}\n`).update(bytes);
  }
  return hash.digest("hex");
}

const { version } = JSON.parse(readFileSync(new URL("node_modules/three/package.json", HERE)));
const licence = readFileSync(new URL("node_modules/three/LICENSE", HERE), "utf8").trim();
const banner = (name) => `/*!
dronecombat-jax ${name} page (MIT). Built by viewer/build.mjs; do not edit.
sources sha256 ${digest()}

It contains three.js ${version} (threejs.org), which is used under this licence:

${licence}
*/`;

for (const [name, entry] of Object.entries(ENTRIES)) {
  await build({
    absWorkingDir: FOLDER,
    entryPoints: [entry],
    outfile: resolve(FOLDER, OUT, `${name}.js`),
    bundle: true,
    minify: true,
    charset: "ascii",
    format: "iife",
    target: "es2022",
    loader: { ".css": "text" },
    define: { SOURCES: JSON.stringify(digest()) },
    banner: { js: banner(name) },
    legalComments: "none",
  });
}
copyFileSync(new URL("node_modules/three/LICENSE", HERE), resolve(FOLDER, OUT, "three.LICENSE"));
