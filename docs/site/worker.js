// Words of a message are not what a search takes by itself: short ones would be beginnings of any word, quotation marks
// and hyphens would mean something, and names, numbers and paths are nowhere on these pages. What is pasted is reduced to
// its words and looked for among the messages; a question loses its small words.
const COMMON = "about after and another any are back been beside but can could does for from get has have here how its many more must need not one only our out own should that the their them then there they this use want was were what when where which why with without you your error".split(" ");
const asWords = (query) => {
  const words = query.split(/\s+/).map((word) => word.replace(/^\W+|\W+$/g, ""));
  if (words.length < 4) return query;
  const kept = words.filter((word) => /^[a-z][a-z'-]{2,}$/i.test(word) && !COMMON.includes(word.toLowerCase()));
  if (!kept.length) return query;
  const message = /[:;,`'"/()\d]/.test(query);
  if (!message) return kept.join(" ");
  return ["+text:highfivemessages^1", ...kept.map((word) => `text:${word.replace(/[-'].*/, "")}^1`)].join(" ");
};
const wordsOf = (text) => text.toLowerCase().match(/[\p{L}\d]+/gu) || [];

// Parts that have the same words are told apart by how many of them stand together there as they do in what was asked for.
let asked = [];
const together = (text) => {
  const there = ` ${wordsOf(text.replace(/<[^>]+>/g, "")).join(" ")} `;
  for (let length = asked.length; length > 1; length--)
    for (let start = 0; start + length <= asked.length; start++)
      if (there.includes(` ${asked.slice(start, start + length).join(" ")} `)) return length;
  return 0;
};
const inOrder = (data) => {
  if (data && data.type === 3)
    for (const page of data.data.items)
      if (page.some((part) => (part.location || "").startsWith("reference/messages"))) {
        const found = new Map(page.map((part) => [part, part.parent ? together(part.text || "") : Infinity]));
        page.sort((one, other) => found.get(other) - found.get(one));
      }
  return data;
};
const asQuery = (data) => {
  if (!data || data.type !== 2) return data;
  asked = wordsOf(data.data);
  return { ...data, data: asWords(data.data) };
};

// Browsers start no worker of a page that was opened from a file. The search's script then runs in a hidden frame.
if (location.protocol === "file:")
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = [];
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.documentElement.append(frame);
      this.inside = frame.contentWindow;
      this.inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data: inOrder(data) }));
      const script = frame.contentDocument.createElement("script");
      script.src = url;
      script.onload = () => {
        const waiting = this.waiting;
        this.waiting = null;
        waiting.forEach((data) => this.postMessage(data));
      };
      frame.contentDocument.head.append(script);
    }
    postMessage(data) {
      if (this.waiting) this.waiting.push(data);
      else this.inside.dispatchEvent(new this.inside.MessageEvent("message", { data: asQuery(data) }));
    }
  };
else
  window.Worker = class extends window.Worker {
    constructor(url) {
      super(url);
      this.addEventListener("message", (event) => inOrder(event.data));
    }
    postMessage(data) {
      super.postMessage(asQuery(data));
    }
  };
