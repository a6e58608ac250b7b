// Makes the viewer page for `gsvx view`.
import { writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { gzipSync } from 'node:zlib';
import { page } from './bundle.mjs';

const file = join(import.meta.dirname, '../../../gsvx-cli/view/index.html.gz');
const html = await page('index.html');
const packed = gzipSync(html, { level: 9 });
writeFileSync(file, packed);
console.log(`${file}: ${html.length} bytes, ${packed.length} compressed`);
