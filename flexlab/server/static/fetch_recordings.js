// For the viewer's page. By itself the viewer requests recordings without cookies, so that a hub's login keeps it out. It requests
// them whole, which fails for long ones behind proxies that hold an answer until it is complete. And it asks its makers for news
// and reports its use to them, which the page's policy refuses with error messages.
{ const plain = fetch, PART = 8e6;
  const ask = (what, options) => plain(new Request(new Request(what, options), { credentials: "same-origin" }));
  fetch = async (what, options) => {
    const asked = new Request(what, options);
    if (/^https?:/.test(asked.url) && new URL(asked.url).origin !== location.origin) return new Response(null, { status: 503 });
    if (asked.method !== "GET" || !new URL(asked.url).pathname.endsWith(".rrd")) return ask(asked);
    const part = from => ask(new Request(asked, { headers: { Range: `bytes=${from}-${from + PART - 1}` } }));
    const first = await part(0), size = +(first.headers.get("Content-Range") ?? "").split("/")[1];
    if (first.status !== 206 || !size) return first;
    let reader = first.body.getReader(), got = 0;
    const body = new ReadableStream({ async pull(sink) {
      for (;;) {
        const { done, value } = await reader.read();
        if (!done) { got += value.length; return sink.enqueue(value); }
        if (got >= size) return sink.close();
        const next = await part(got);
        if (next.status !== 206) throw new Error(`the server answers ${next.status}`);
        reader = next.body.getReader();
      }
    } });
    return new Response(body, { headers: { "Content-Type": first.headers.get("Content-Type"), "Content-Length": size } });
  }; }
// By itself the viewer takes the focus as it starts and captures Tab: without a mouse, nobody could get back to the page around it.
{ const focus = HTMLElement.prototype.focus;
  let touched = false;
  addEventListener("pointerdown", () => { touched = true; }, true);
  addEventListener("keydown", (event) => { if (event.key === "Tab") event.stopImmediatePropagation(); }, true);
  const seen = new CSSStyleSheet();
  seen.replaceSync("canvas:focus-visible { outline: 3px solid #d9822b !important; outline-offset: -3px }");
  document.adoptedStyleSheets.push(seen);
  HTMLElement.prototype.focus = function (...options) { if (touched || document.hasFocus()) focus.apply(this, options); }; }
