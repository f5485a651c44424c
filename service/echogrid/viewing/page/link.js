// The WebSocket to the server: comes back by itself, and says why it went.
import { decode } from "./wire.js";

const FIRST_PAUSE = 500; // ms
const LONGEST_PAUSE = 5000;
const NO_TOKEN = 4401; // see server.py

export class Link {
  /** `hear` is given each frame, `tell` the state: "open", "lost" or "token", and the server's reason. `begin`: what is said first. */
  constructor({ hear, tell, begin }) {
    this.hear = hear;
    this.tell = tell;
    this.begin = begin;
    this.pause = FIRST_PAUSE;
    this.reason = "";
    this.open();
  }

  open() {
    clearTimeout(this.timer);
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.say(this.begin());
    socket.onmessage = ({ data }) => {
      if (this.pause !== FIRST_PAUSE || !this.heard) this.tell("open", "");
      this.heard = true;
      this.pause = FIRST_PAUSE;
      this.hear(decode(data), data.byteLength);
    };
    socket.onclose = ({ code, reason }) => {
      this.heard = false;
      if (code === NO_TOKEN) return this.tell("token", reason);
      this.tell("lost", reason || "the server cannot be reached");
      this.timer = setTimeout(() => this.open(), this.pause);
      this.pause = Math.min(this.pause * 2, LONGEST_PAUSE);
    };
    this.socket = socket;
  }

  say(words) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(words));
  }
}
