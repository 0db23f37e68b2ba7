// A client of node-opcua that orders one part and reads its result; one JSON object a line.
// node opcua_stranger.js URL CERTIFICATE KEY FOLDER USER PASSWORD RECIPE SERIAL
const opcua = require("node-opcua-client");
const [url, certificateFile, privateKeyFile, folder, userName, password, recipe, serial] =
  process.argv.slice(2);
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");
const { AddNodesRequest } = require("node-opcua-types");
const { DataType } = opcua;
const say = (step, value) => console.log(JSON.stringify({ step, value }));

async function client(more) {
  const manager = new OPCUACertificateManager({
    rootFolder: folder,
    automaticallyAcceptUnknownCertificate: true, // of the server
  });
  await manager.initialize();
  return opcua.OPCUAClient.create({
    applicationUri: "urn:test:mes",
    certificateFile,
    privateKeyFile,
    clientCertificateManager: manager,
    securityMode: opcua.MessageSecurityMode.SignAndEncrypt,
    securityPolicy: opcua.SecurityPolicy.Aes256_Sha256_RsaPss,
    connectionStrategy: { maxRetry: 0 },
    endpointMustExist: false,
    requestedSessionTimeout: 60000,
    transportTimeout: 60000,
    ...more,
  });
}

async function refused(step, more, identity) {
  const one = await client(more);
  try {
    await one.connect(url);
    const session = await one.createSession(identity);
    await session.close();
    say(step, "let in");
  } catch (error) {
    say(step, String(error.message).split("\n")[0].slice(0, 200));
  }
  await one.disconnect().catch(() => {});
}

async function main() {
  const named = { type: opcua.UserTokenType.UserName, userName, password };
  await refused("wrong password", {}, { ...named, password: "wrong password" });
  await refused("anonymous", {}, { type: opcua.UserTokenType.Anonymous });
  await refused(
    "policy None",
    { securityMode: opcua.MessageSecurityMode.None, securityPolicy: opcua.SecurityPolicy.None },
    named
  );

  const one = await client();
  await one.connect(url);
  const session = await one.createSession(named);
  say("logged in", true);
  const namespaces = await session.readNamespaceArray();
  const ns = namespaces.indexOf("http://opcfoundation.org/UA/MachineVision");
  const vision = "ns=1;s=VisionSystem";
  const record = (number, fields) =>
    session.constructExtensionObject(opcua.coerceNodeId(`ns=${ns};i=${number}`), fields);
  const call = async (path, method, inputArguments) => {
    const objectId = `${vision}.${path}`;
    const done = await session.call({ objectId, methodId: `${objectId}.${method}`, inputArguments });
    if (!done.statusCode.isGood()) throw new Error(`${method}: ${done.statusCode}`);
    return done.outputArguments.map((one) => one.value);
  };
  const struct = (value) => ({ dataType: DataType.ExtensionObject, value });
  const none = { dataType: DataType.ExtensionObject, value: null };
  const int32 = (value) => ({ dataType: DataType.Int32, value });
  const uint32 = (value) => ({ dataType: DataType.UInt32, value });

  const subscription = await session.createSubscription2({
    requestedPublishingInterval: 50,
    requestedLifetimeCount: 1000,
    requestedMaxKeepAliveCount: 20,
    publishingEnabled: true,
  });
  const fields = ["EventType", "Message", "ResultId", "ResultContent", "ResultState", "PartId"];
  const browsed = fields.map((name, i) => (i < 2 ? name : `${ns}:${name}`));
  const item = await subscription.monitor(
    { nodeId: "i=2253", attributeId: opcua.AttributeIds.EventNotifier },
    { queueSize: 100, filter: opcua.constructEventFilter(browsed) },
    opcua.TimestampsToReturn.Both
  );
  const ready = new Promise((resolve) => {
    item.on("changed", (event) => {
      say("event", event[1].value.text);
      if (event[0].value.value === 1024 && event[0].value.namespace === ns) resolve(event);
    });
  });

  const recipes = await call("RecipeManagement", "GetRecipeListFiltered", [
    none, none, int32(2), uint32(0), uint32(0), int32(0),
  ]);
  say("recipes", recipes[3].map((one) => one.id));
  const prepared = await call("RecipeManagement", "PrepareRecipe", [
    struct(await record(3002, { id: recipe })), none,
  ]);
  say("prepared", [prepared[0].id, prepared[1], prepared[2]]);
  const machine = "VisionStateMachine.AutomaticModeStateMachine";
  const job = await call(machine, "StartSingleJob", [
    struct(await record(3015, { id: `PO-${serial}` })),
    struct(await record(3004, { id: serial })),
    none, none,
    { dataType: DataType.Variant, arrayType: opcua.VariantArrayType.Array, value: [] },
  ]);
  say("job", [job[0].id, job[1]]);
  const state = await session.read({ nodeId: `${vision}.${machine}.CurrentState` });
  say("state", state.value.value.text);

  const write = await session.write({
    nodeId: `${vision}.VisionStateMachine.CurrentState`,
    attributeId: opcua.AttributeIds.Value,
    value: { value: { dataType: DataType.LocalizedText, value: { text: "Halted" } } },
  });
  say("write", write.name);
  const added = await session.performMessageTransaction(
    new AddNodesRequest({ nodesToAdd: [{ parentNodeId: "i=85", browseName: "mine" }] })
  ).then((answer) => answer.responseHeader.serviceResult.name, (error) => error.message);
  say("add nodes", String(added).split("\n")[0].slice(0, 200));

  const event = await ready;
  const id = event[2].value.id;
  say("result ready", {
    id, json: JSON.parse(event[3].value[0].value), verdict: event[3].value[1].value,
    state: event[4].value, serial: event[5].value.id,
  });
  const result = await call("ResultManagement", "GetResultById", [
    struct(await record(3021, { id })), int32(5000),
  ]);
  say("result", {
    id: result[1].resultId.id, json: JSON.parse(result[1].resultContent[0].value),
    serial: result[1].partId.id, error: result[2], job: result[1].jobId.id,
  });
  await session.close();
  await one.disconnect();
}

main().then(() => process.exit(0), (error) => {
  console.error(error);
  process.exit(1);
});
