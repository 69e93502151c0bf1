//! The force network as an ONNX model (opset 17), with batch norm folded in as in our engine, written as
//! protocol buffers by hand: seven messages of onnx.proto, field numbers beside their names.

use gripline_network::weights::Weights;
use gripline_network::{Folded, LayerKind, OUTPUT, folded};

/// The bytes of one message.
#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn int(mut self, field: u64, value: usize) -> Self {
        self.varint(field << 3);
        self.varint(value as u64);
        self
    }

    fn ints(self, field: u64, values: &[usize]) -> Self {
        values
            .iter()
            .fold(self, |message, &value| message.int(field, value))
    }

    fn bytes(mut self, field: u64, bytes: &[u8]) -> Self {
        self.varint(field << 3 | 2);
        self.varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
        self
    }

    fn text(self, field: u64, text: &str) -> Self {
        self.bytes(field, text.as_bytes())
    }

    fn message(self, field: u64, message: &Message) -> Self {
        self.bytes(field, &message.0)
    }
}

/// Builds the graph node by node.
struct Graph {
    /// GraphProto: node = 1, name = 2, initializer = 5, input = 11, output = 12.
    graph: Message,
}

impl Graph {
    /// NodeProto: input = 1, output = 2, op_type = 4, attribute = 5.
    fn node(&mut self, operator: &str, inputs: &[&str], output: &str, attributes: &[(&str, &[usize])]) {
        let mut node = Message::default();
        for input in inputs {
            node = node.text(1, input);
        }
        node = node.text(2, output).text(4, operator);
        for (name, values) in attributes {
            // AttributeProto: name = 1, i = 3, ints = 8, type = 20 (INT 2, INTS 7).
            let attribute = Message::default().text(1, name);
            let attribute = match values {
                [value] => attribute.int(3, *value).int(20, 2),
                values => attribute.ints(8, values).int(20, 7),
            };
            node = node.message(5, &attribute);
        }
        self.graph = std::mem::take(&mut self.graph).message(1, &node);
    }

    /// TensorProto: dims = 1, data_type = 2 (FLOAT 1), name = 8, raw_data = 9.
    fn tensor(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let tensor = Message::default()
            .ints(1, shape)
            .int(2, 1)
            .text(8, name)
            .bytes(9, &raw);
        self.graph = std::mem::take(&mut self.graph).message(5, &tensor);
    }

    /// ValueInfoProto: name = 1, type = 2; TypeProto: tensor_type = 1; its elem_type = 1, shape = 2; the shape's
    /// dim = 1; its dim_value = 1.
    fn value(&mut self, field: u64, name: &str, shape: &[usize]) {
        let mut dims = Message::default();
        for &size in shape {
            dims = dims.message(1, &Message::default().int(1, size));
        }
        let tensor = Message::default().int(1, 1).message(2, &dims);
        let value = Message::default()
            .text(1, name)
            .message(2, &Message::default().message(1, &tensor));
        self.graph = std::mem::take(&mut self.graph).message(field, &value);
    }

    /// A layer, with its ReLU unless it is the last.
    fn layer(&mut self, folded: &Folded, from: &str) -> String {
        let Folded { layer, weights, bias } = folded;
        let name = layer.name;
        let (weight_name, bias_name) = (format!("{name}.weight"), format!("{name}.bias"));
        let (operator, channels, stride, padding) = match layer.kind {
            LayerKind::Convolution { stride, padding } => {
                ("Conv", [layer.out_channels, layer.in_channels], stride, padding)
            }
            LayerKind::Doubling => ("ConvTranspose", [layer.in_channels, layer.out_channels], 2, 1),
        };
        self.tensor(&weight_name, &[channels[0], channels[1], 3, 3], weights);
        self.tensor(&bias_name, &[layer.out_channels], bias);
        let (strides, pads) = ([stride; 2], [padding; 4]);
        let mut attributes: Vec<(&str, &[usize])> =
            vec![("kernel_shape", &[3, 3]), ("strides", &strides), ("pads", &pads)];
        if layer.kind == LayerKind::Doubling {
            attributes.push(("output_padding", &[1, 1]));
        }
        let inputs = [from, &weight_name, &bias_name];
        if name == OUTPUT {
            self.node(operator, &inputs, name, &attributes);
        } else {
            let sum = format!("{name}.sum");
            self.node(operator, &inputs, &sum, &attributes);
            self.node("Relu", &[&sum], name, &[]);
        }
        name.to_owned()
    }

    fn pool(&mut self, from: &str, name: &str) -> String {
        self.node(
            "MaxPool",
            &[from],
            name,
            &[("kernel_shape", &[2, 2]), ("strides", &[2, 2])],
        );
        name.to_owned()
    }

    fn join(&mut self, first: &str, second: &str, name: &str) -> String {
        self.node("Concat", &[first, second], name, &[("axis", &[1])]);
        name.to_owned()
    }
}

/// The model's bytes. Input `input`, 1×2×88×88: difference and rest image in the network's units; output
/// `output`, 1×3×20×20, the network's units.
pub(crate) fn model(weights: &Weights) -> Vec<u8> {
    let mut layers = folded(weights);
    let mut graph = Graph {
        graph: Message::default().text(2, "unet"),
    };
    let mut next = |graph: &mut Graph, from: &str| {
        let layer = layers.next().expect("as many layers as the architecture has");
        graph.layer(&layer, from)
    };
    let at44 = next(&mut graph, "input");
    let at22 = next(&mut graph, &at44);
    let at20 = next(&mut graph, &at22);
    let encoded20 = next(&mut graph, &at20);
    let pooled = graph.pool(&encoded20, "pooled10");
    let at10 = next(&mut graph, &pooled);
    let encoded10 = next(&mut graph, &at10);
    let pooled = graph.pool(&encoded10, "pooled5");
    let at5 = next(&mut graph, &pooled);
    let at5 = next(&mut graph, &at5);
    let up10 = next(&mut graph, &at5);
    let joined = graph.join(&up10, &encoded10, "joined10");
    let at10 = next(&mut graph, &joined);
    let at10 = next(&mut graph, &at10);
    let up20 = next(&mut graph, &at10);
    let joined = graph.join(&up20, &encoded20, "joined20");
    let at20 = next(&mut graph, &joined);
    let at20 = next(&mut graph, &at20);
    let output = next(&mut graph, &at20);
    graph.value(11, "input", &[1, 2, 88, 88]);
    graph.value(12, &output, &[1, 3, 20, 20]);

    // ModelProto: ir_version = 1, producer_name = 2, graph = 7, opset_import = 8 (its version = 2).
    Message::default()
        .int(1, 8)
        .text(2, "gripline")
        .message(7, &graph.graph)
        .message(8, &Message::default().int(2, 17))
        .0
}
