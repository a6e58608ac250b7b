// Makes the page of `cargo xtask demo`: node demo.mjs FOLDER FACTS, where FACTS are what demo.js knows of the scene.
import { writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { page } from './bundle.mjs';

const [folder, facts] = process.argv.slice(2);
writeFileSync(join(folder, 'index.html'), await page('demo.html', { FACTS: facts }));
