// Watching a film or camera: its tracks as server-sent events, its frames as a stream of JPEG. Both by fetch, which can
// bring a token.

const KEPT_RECORDS = 100;
/** How long the last frames may take after the end of the tracks. */
const LAST_FRAMES_MS = 3000;

/**
 * Watches until the film ends or `signal` says so. `show(image, record)` gets each frame with its tracks, `camera` what
 * took it. Answers "end" or "failed".
 */
export async function watch(name, { headers, signal, camera, show }) {
  const path = `v1/videos/${encodeURIComponent(name)}`;
  const records = new Map();
  const over = new AbortController();
  const both = AbortSignal.any([signal, over.signal]);
  const events = await opened(`${path}/tracks`, headers, both);
  const parts = await opened(`${path}/frames?plain=true`, headers, both);
  const frames = readFrames(parts, async (number, jpeg) => {
    const image = await createImageBitmap(jpeg);
    // Its tracks come first, as they are shorter; where they did not, those before it are nearly right.
    if (!over.signal.aborted) show(image, records.get(number) ?? [...records.values()].at(-1));
  });
  try {
    return await readEvents(events, (event, data) => {
      if (event === "camera") camera(data);
      if (event === "frame") {
        records.set(data.frame, data);
        if (records.size > KEPT_RECORDS) records.delete(records.keys().next().value);
      }
    });
  } finally {
    // The last frames may still be on their way; none is shown after the end was told.
    await Promise.race([frames.catch(() => {}), new Promise((resolve) => setTimeout(resolve, LAST_FRAMES_MS))]);
    over.abort();
  }
}

async function opened(path, headers, signal) {
  const response = await fetch(path, { headers, signal });
  if (response.ok) return response.body.getReader();
  const answer = await response.json().catch(() => ({}));
  const error = new Error(answer.error?.message ?? `the service answered ${response.status}`);
  error.status = response.status;
  throw error;
}

/** Reads events until one says that there are no more: "end" or "failed". */
async function readEvents(reader, tell) {
  const decoder = new TextDecoder();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) throw new Error("the film broke off");
    text += decoder.decode(value, { stream: true });
    const events = text.split("\n\n");
    text = events.pop();
    for (const event of events) {
      const field = (line) => [line.split(":")[0], line.slice(line.indexOf(":") + 1).trim()];
    const fields = new Map(event.split("\n").map(field));
      const name = fields.get("event");
      if (name === "end" || name === "failed") return name;
      if (name) tell(name, JSON.parse(fields.get("data")));
    }
  }
}

/** Reads the parts of a multipart stream: their numbers and pictures. */
async function readFrames(reader, tell) {
  let bytes = new Uint8Array(0);
  const more = async () => {
    const { value, done } = await reader.read();
    if (done) return false;
    const joined = new Uint8Array(bytes.length + value.length);
    joined.set(bytes);
    joined.set(value, bytes.length);
    bytes = joined;
    return true;
  };
  for (;;) {
    let head = headOf(bytes);
    while (!head) {
      if (!await more()) return;
      head = headOf(bytes);
    }
    const end = head.length + head.contentLength;
    while (bytes.length < end) if (!await more()) return;
    const jpeg = new Blob([bytes.slice(head.length, end)], { type: "image/jpeg" });
    bytes = bytes.slice(end);
    await tell(head.frame, jpeg);
  }
}

/** The head of the first part, if it is all there. */
function headOf(bytes) {
  const text = String.fromCharCode(...bytes.subarray(0, 512));
  const end = text.indexOf("\r\n\r\n");
  if (end < 0) return null;
  const number = (name) => Number(new RegExp(`${name}: (\\d+)`, "i").exec(text.slice(0, end))?.[1]);
  return { length: end + 4, contentLength: number("content-length"), frame: number("x-frame") };
}
