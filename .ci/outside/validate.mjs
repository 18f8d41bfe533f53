// Prints the errors and warnings of the Khronos validator for a GLB file; fails if there are any.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';

const [modules, file] = process.argv.slice(2);
const { validateBytes } = createRequire(`${modules}/`)('gltf-validator');
const { issues } = await validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 20 });
const wrong = issues.messages.filter(({ severity }) => severity < 2);
if (wrong.length > 0) console.log(JSON.stringify(wrong, null, 1));
process.exit(issues.numErrors + issues.numWarnings > 0 ? 1 : 0);
