// Reads a recording whole, with @mcap/core and @foxglove/rosmsg2-serialization, and prints as JSON what of each topic there is.
import { McapIndexedReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { decompress } from "fzstd";
import { open } from "node:fs/promises";

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (at, length) => {
    const bytes = new Uint8Array(Number(length));
    await file.read(bytes, 0, Number(length), Number(at));
    return bytes;
  },
};
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: { zstd: (data) => decompress(data) } });
const decoders = new Map();
const told = {};
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  if (!decoders.has(channel.id)) {
    const schema = reader.schemasById.get(channel.schemaId);
    decoders.set(channel.id, new MessageReader(parse(new TextDecoder().decode(schema.data), { ros2: true })));
  }
  const decoded = decoders.get(channel.id).readMessage(message.data);
  const topic = (told[channel.topic] ??= { messages: 0, sum: 0 });
  topic.messages += 1;
  const data = decoded.data; // of maps, updates, frames and texts
  if (typeof data === "object") for (const value of data) topic.sum += value;
}
console.log(JSON.stringify(told));
