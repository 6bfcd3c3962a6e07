// Prints each message of an MCAP file, as Foxglove's npm packages decode it, as a line of JSON:
// [topic, log time in ns, schema, message]. Topics follow each other in the order of their names.
//
//     node read_bag.mjs FILE.mcap
//
// A 64-bit integer is {"int": text}, a number that JSON lacks {"float": text}.

import { once } from "node:events";
import { open } from "node:fs/promises";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import zstd from "@foxglove/wasm-zstd";
import { McapIndexedReader } from "@mcap/core";

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const bytes = new Uint8Array(Number(length));
    const { bytesRead } = await file.read(bytes, 0, bytes.length, Number(offset));
    if (bytesRead !== bytes.length) throw new Error(`${bytesRead} of ${length} bytes at ${offset}`);
    return bytes;
  },
};
await zstd.isLoaded;
const decompressHandlers = { zstd: (bytes, size) => zstd.decompress(bytes, Number(size)) };
const bag = await McapIndexedReader.Initialize({ readable, decompressHandlers });

const channels = [...bag.channelsById.values()];
for (const topic of [...new Set(channels.map((each) => each.topic))].sort()) {
  const readers = new Map();
  for await (const message of bag.readMessages({ topics: [topic] })) {
    const { schemaId } = bag.channelsById.get(message.channelId);
    const schema = bag.schemasById.get(schemaId);
    if (!readers.has(schemaId)) {
      const definition = new TextDecoder().decode(schema.data);
      const options = { timeType: "sec,nanosec" };
      readers.set(schemaId, new MessageReader(parse(definition, { ros2: true }), options));
    }
    const decoded = readers.get(schemaId).readMessage(message.data);
    const line = JSON.stringify([topic, message.logTime, schema.name, decoded], exactly);
    if (!process.stdout.write(`${line}\n`)) await once(process.stdout, "drain");
  }
}
await file.close();

function exactly(key, value) {
  if (typeof value === "bigint") return { int: String(value) };
  if (ArrayBuffer.isView(value)) return Array.from(value);
  if (typeof value !== "number" || (Number.isFinite(value) && !Object.is(value, -0))) return value;
  return { float: Object.is(value, -0) ? "-0.0" : String(value).replace("Infinity", "inf") };
}
