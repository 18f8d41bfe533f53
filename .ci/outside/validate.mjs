// Prints the errors and warnings of the Khronos validator for a GLB file; fails if there are any.
// This version of it does not know the attributes of KHR_gaussian_splatting, whose names have a colon.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';

const [modules, file] = process.argv.slice(2);
const { validateBytes } = createRequire(`${modules}/`)('gltf-validator');
const { issues } = await validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 20 });
const isUnknown = ({ code, pointer }) => code === 'MESH_PRIMITIVE_INVALID_ATTRIBUTE' && pointer.includes('/KHR_gaussian_splatting:');
const wrong = issues.messages.filter((message) => message.severity < 2 && !isUnknown(message));
if (wrong.length > 0) console.log(JSON.stringify(wrong, null, 1));
process.exit(wrong.length > 0 || issues.truncated ? 1 : 0);
