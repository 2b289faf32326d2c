// The connection to the node: one WebSocket, bundles in, one acknowledgement per bundle out after it has been drawn.

/** Split a bundle into parts: {panel, kind, ...meta, payload: Uint8Array}. */
export function parseBundle(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const parts = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let offset = 4 + length;
  for (const part of parts) {
    part.payload = new Uint8Array(buffer, offset, part.bytes);
    offset += part.bytes + ((4 - (part.bytes % 4)) % 4);
  }
  return parts;
}

const RETRY_MS = 2000;

/** handlers: hello(graph), draw(parts) after which the credit goes back, prepare(part) -> promise, state(text), end(failure),
 * error(text). */
export class Wire {
  constructor(handlers) {
    this.handlers = handlers;
    this.panels = [];
    this.connect();
  }

  connect() {
    const url = new URL("ws", document.baseURI);
    url.protocol = url.protocol.replace("http", "ws");
    this.socket = new WebSocket(url);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = (message) => this.receive(message.data);
    let ended = false; // said in words: the code is lost when the closing handshake is cut off
    this.end = (failure) => {
      ended = true;
      this.handlers.end(failure);
    };
    this.socket.onclose = (event) => {
      this.handlers.state(ended || event.code === 1001 ? "finished" : "closed");
      setTimeout(() => this.connect(), RETRY_MS);
    };
  }

  async receive(data) {
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.op === "hello") {
        this.handlers.hello(message);
        this.show(this.panels);
      } else if (message.op === "end") {
        this.end(message.failure);
      } else if (message.op === "error") {
        this.handlers.error(message.text);
      }
      return;
    }
    const socket = this.socket;
    try {
      const parts = parseBundle(data);
      await Promise.all(parts.map((part) => this.handlers.prepare(part)));
      await new Promise(requestAnimationFrame);
      this.handlers.draw(parts);
    } finally {
      if (socket.readyState === WebSocket.OPEN) socket.send('{"op":"ack"}');
    }
  }

  /** Everything that is open from now on: [{id, topic, view, env}]. */
  show(panels) {
    this.panels = panels;
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ op: "panels", panels }));
  }
}
