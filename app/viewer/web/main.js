// The page's scripts. Loaded before the template is mounted.
import { watchServer } from "./watch.js";
import { soundAlarm } from "./alarm.js";
import { listenToKeys } from "./keys.js";

const updateAlarm = soundAlarm(window.trame);
watchServer(window.trame, updateAlarm);
listenToKeys(window.trame);
