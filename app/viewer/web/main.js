// Everything of the page that is no template. Loaded before the page is mounted.
import { watchServer } from "./watch.js";
import { soundAlarm } from "./alarm.js";
import { listenToKeys } from "./keys.js";

const listen = soundAlarm(window.trame);
watchServer(window.trame, listen);
listenToKeys(window.trame);
