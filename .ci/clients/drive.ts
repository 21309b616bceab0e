// Drives the service with the generated TypeScript types: drive.js ADDRESS FILE
import { readFile } from "node:fs/promises";
import process from "node:process";
import createClient from "openapi-fetch";
import type { paths } from "./schema.js";

const BASES = 12;

function wanted<T>(found: { data?: T; error?: unknown }): T {
  if (found.data === undefined) throw new Error(JSON.stringify(found.error));
  return found.data;
}

const [address, path] = process.argv.slice(2);
if (address === undefined || path === undefined) throw new Error("usage: drive.js ADDRESS FILE");
const client = createClient<paths>({ baseUrl: address });

const file = await readFile(path);
const submitted = wanted(
  await client.POST("/clouds", {
    params: { query: { bases: BASES } },
    headers: { "Content-Type": "application/octet-stream" },
    body: file as unknown as string,
    bodySerializer: (body) => body as unknown as BodyInit,
  }),
);
const id = submitted.job?.id;
if (id === undefined) throw new Error("no job was queued");
let state: string = "queued";
while (state === "queued" || state === "running") {
  state = wanted(await client.GET("/jobs/{id}", { params: { path: { id }, query: { wait: 30 } } })).state;
}
if (state !== "succeeded") throw new Error(`the job ended ${state}`);
const bases = wanted(
  await client.GET("/jobs/{id}/bases.npy", { params: { path: { id } }, parseAs: "arrayBuffer" }),
);
const magic = new TextDecoder("latin1").decode(bases.slice(1, 6));
const numbers = bases.byteLength / BASES / 4;
if (magic !== "NUMPY" || numbers < submitted.cloud.points) throw new Error(`${magic}, ${bases.byteLength} bytes`);
const spectrum = wanted(await client.GET("/jobs/{id}/spectrum", { params: { path: { id } } }));
if (typeof spectrum === "string" || spectrum.eigenvalues.length !== BASES) throw new Error("a spectrum of another length");
console.log(`TypeScript: ${submitted.cloud.points} points, ${BASES} bases in ${bases.byteLength} bytes`);
