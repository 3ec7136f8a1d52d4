// A folder that was dropped, as a zip without compression, which the service takes.

const WANTED = /\.(urdf|srdf|xacro|xml|stl|dae|obj|mtl|ply|png|jpe?g)$/i; // what a robot is made of
const TABLE = Uint32Array.from({ length: 256 }, (_, number) => {
  let rest = number;
  for (let bit = 0; bit < 8; bit++) rest = rest & 1 ? 0xedb88320 ^ (rest >>> 1) : rest >>> 1;
  return rest;
});

/** The files of a robot in an entry of the file system: [{path, file}]. */
export async function filesIn(entry, path = entry.name) {
  if (entry.isFile) {
    return WANTED.test(path) ? [{ path, file: await new Promise((done, fail) => entry.file(done, fail)) }] : [];
  }
  const reader = entry.createReader();
  const found = [];
  for (;;) {
    const some = await new Promise((done, fail) => reader.readEntries(done, fail)); // a part of them at a time
    if (!some.length) return found;
    for (const each of some) found.push(...(await filesIn(each, `${path}/${each.name}`)));
  }
}

/** A zip of files [{path, file}], as a File of this name (APPNOTE.TXT 4.3: local headers, central directory, end). */
export async function zipOf(files, name) {
  const parts = [];
  const directory = [];
  let at = 0;
  for (const { path, file } of files) {
    const bytes = new Uint8Array(await file.arrayBuffer());
    const label = new TextEncoder().encode(path);
    // version 2.0, names in UTF-8, stored, 1 January 1980, checksum, size twice, length of the name, no more
    const about = numbers([2, 20], [2, 0x800], [2, 0], [2, 0], [2, 33], [4, checksum(bytes)], [4, bytes.length],
      [4, bytes.length], [2, label.length], [2, 0]); // prettier-ignore
    const header = [numbers([4, 0x04034b50]), about, label];
    directory.push(numbers([4, 0x02014b50], [2, 20]), about, numbers([2, 0], [2, 0], [2, 0], [4, 0], [4, at]), label);
    parts.push(...header, bytes);
    at += sizeOf(header) + bytes.length;
  }
  const count = files.length;
  const end = numbers([4, 0x06054b50], [4, 0], [2, count], [2, count], [4, sizeOf(directory)], [4, at], [2, 0]);
  return new File([...parts, ...directory, end], `${name}.zip`, { type: "application/zip" });
}

function sizeOf(parts) {
  return parts.reduce((sum, part) => sum + part.length, 0);
}

/** Little-endian whole numbers, each [bytes, value]. */
function numbers(...fields) {
  return Uint8Array.from(fields.flatMap(([size, value]) => Array.from({ length: size }, (_, k) => (value >>> (8 * k)) & 255)));
}

/** The CRC-32 of bytes. */
function checksum(bytes) {
  let rest = ~0;
  for (const byte of bytes) rest = TABLE[(rest ^ byte) & 255] ^ (rest >>> 8);
  return ~rest >>> 0;
}
