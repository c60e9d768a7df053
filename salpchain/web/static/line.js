// The line to the server of `salpchain live`: a WebSocket, dialled again whenever it breaks. The swim
// page has another Line (swim/line.js), behind which the world swims in the browser itself.
"use strict";
const Line = (() => {
  const where = "on the server";

  // `hear` gets every message, `banner` what to show meanwhile, `lost` and `back` say how it goes.
  function open({ hear, banner, begun, lost, back }) {
    let socket = null, tries = 0, waiting = null;

    function connect() {
      clearTimeout(waiting);
      banner(tries ? "Trying to reach the server again ..." : "Connecting ...", tries > 0);
      socket = new WebSocket(new URL("swim", location.href).href.replace(/^http/, "ws"));
      socket.onopen = () => { begun(); banner("The water is being let in ..."); };
      socket.onmessage = (event) => {
        const message = JSON.parse(event.data);
        if (message.type === "state") {
          if (tries) back();
          tries = 0;
        }
        hear(message);
      };
      socket.onclose = (event) => {
        const wait = Math.min(0.5 * 2 ** tries, 5);
        tries += 1;
        const why = event.code === 1013 ? "Too many browsers watch already."
          : "The server has gone away. Is salpchain live still running in its terminal?";
        banner(`${why} Trying again by itself ...`, true);
        waiting = setTimeout(connect, 1000 * wait);
        lost();
      };
    }

    connect();
    return (message) => {
      if (socket.readyState !== WebSocket.OPEN) return false;
      socket.send(JSON.stringify(message));
      return true;
    };
  }

  const recording = (number) => `recordings/${number}.html`; // where the replay of a recording is

  return { open, recording, where };
})();
