//! The force networks as ONNX models (opset 17), with batch norm folded in as in our engine, written as
//! protocol buffers by hand: seven messages of onnx.proto, field numbers beside their names. With the ranges of its values
//! also in eight bits: values and weights are rounded where they are made, as runtimes expect it of a quantised model.

use std::collections::BTreeMap;

use gripline_network::tracked::{GRID_SIDE, INPUT_CHANNELS, TrackedWeights};
use gripline_network::unet::UnetWeights;
use gripline_network::{Folded, LayerKind, OUTPUT};

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

/// Least and greatest of a tensor's values.
pub(crate) type Ranges = BTreeMap<String, [f32; 2]>;

/// How values are represented.
pub(crate) enum Precision<'a> {
    Float,
    /// f32, and every tensor that can be rounded is an output.
    FloatShown,
    /// Eight bits, except for up-convolutions and the last layer, whose outputs are the forces.
    Int8(&'a Ranges),
}

/// Builds the graph node by node.
struct Graph<'a> {
    /// GraphProto: node = 1, name = 2, initializer = 5, input = 11, output = 12.
    proto: Message,
    precision: Precision<'a>,
    /// Steps of the tensors that are rounded.
    steps: BTreeMap<String, f32>,
}

/// Name of the models' input.
pub(crate) const INPUT: &str = "input";
/// Its shapes: difference and rest image; the grid's channels and the node's place.
pub(crate) const UNET_INPUT: [usize; 4] = [1, 2, 88, 88];
pub(crate) const TRACKED_INPUT: [usize; 4] = [1, INPUT_CHANNELS, GRID_SIDE, GRID_SIDE];

/// TensorProto's data types.
const FLOAT: usize = 1;
const UINT8: usize = 2;
const INT8: usize = 3;
const INT32: usize = 6;

impl Graph<'_> {
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
        self.proto = std::mem::take(&mut self.proto).message(1, &node);
    }

    /// TensorProto: dims = 1, data_type = 2, name = 8, raw_data = 9.
    fn raw(&mut self, name: &str, data_type: usize, shape: &[usize], bytes: &[u8]) {
        let tensor = Message::default()
            .ints(1, shape)
            .int(2, data_type)
            .text(8, name)
            .bytes(9, bytes);
        self.proto = std::mem::take(&mut self.proto).message(5, &tensor);
    }

    fn tensor(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        let raw: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.raw(name, FLOAT, shape, &raw);
    }

    /// A tensor where it is made: as it is, shown, or rounded to a byte and back.
    fn made(&mut self, name: String) -> String {
        let range = match self.precision {
            Precision::Float => return name,
            Precision::FloatShown => {
                // The input is known.
                if name != INPUT {
                    self.value(12, &name, &[]);
                }
                return name;
            }
            Precision::Int8(ranges) => ranges[&name],
        };
        let step = (range[1] - range[0]) / 255.0;
        let zero = (-range[0] / step).round() as u8;
        let [bytes, rounded, step_name, zero_name] =
            ["bytes", "rounded", "step", "zero"].map(|part| format!("{name}.{part}"));
        self.tensor(&step_name, &[], &[step]);
        self.raw(&zero_name, UINT8, &[], &[zero]);
        self.node("QuantizeLinear", &[&name, &step_name, &zero_name], &bytes, &[]);
        self.node(
            "DequantizeLinear",
            &[&bytes, &step_name, &zero_name],
            &rounded,
            &[],
        );
        self.steps.insert(rounded.clone(), step);
        rounded
    }

    /// Weights and bias of a layer that is computed in bytes, each output channel with a step of its own.
    fn quantised_weights(&mut self, folded: &Folded, shape: &[usize], input_step: f32) {
        let name = folded.layer.name;
        let channels = folded.layer.out_channels;
        let (mut steps, mut bytes, mut bias) = (Vec::new(), Vec::new(), Vec::<u8>::new());
        let of_channel = folded.weights.chunks_exact(folded.weights.len() / channels);
        for (weights, value) in of_channel.zip(&folded.bias) {
            let max = weights.iter().fold(1e-9_f32, |max, weight| max.max(weight.abs()));
            let step = max / 127.0;
            steps.push(step);
            bytes.extend(weights.iter().map(|weight| (weight / step).round() as i8 as u8));
            bias.extend(((value / (step * input_step)).round() as i32).to_le_bytes());
        }
        let bias_steps: Vec<f32> = steps.iter().map(|step| step * input_step).collect();
        for (part, data_type, shape, values, steps) in [
            ("weight", INT8, shape, bytes, &steps),
            ("bias", INT32, &[channels][..], bias, &bias_steps),
        ] {
            let whole = format!("{name}.{part}");
            let [stored, step, zero] = ["stored", "step", "zero"].map(|part| format!("{whole}.{part}"));
            let zeros = vec![0; channels * if data_type == INT8 { 1 } else { 4 }];
            self.raw(&stored, data_type, shape, &values);
            self.tensor(&step, &[channels], steps);
            self.raw(&zero, data_type, &[channels], &zeros);
            self.node(
                "DequantizeLinear",
                &[&stored, &step, &zero],
                &whole,
                &[("axis", &[0])],
            );
        }
    }

    /// ValueInfoProto: name = 1, type = 2; TypeProto: tensor_type = 1; its elem_type = 1, shape = 2; the shape's
    /// dim = 1; its dim_value = 1.
    /// Without a shape the runtime finds it out.
    fn value(&mut self, field: u64, name: &str, shape: &[usize]) {
        let mut tensor = Message::default().int(1, FLOAT);
        if !shape.is_empty() {
            let mut dims = Message::default();
            for &size in shape {
                dims = dims.message(1, &Message::default().int(1, size));
            }
            tensor = tensor.message(2, &dims);
        }
        let value = Message::default()
            .text(1, name)
            .message(2, &Message::default().message(1, &tensor));
        self.proto = std::mem::take(&mut self.proto).message(field, &value);
    }

    /// A layer, with its ReLU unless it is the last.
    fn layer(&mut self, folded: &Folded, from: &str) -> String {
        let Folded { layer, weights, bias } = folded;
        let name = layer.name;
        let (weight_name, bias_name) = (format!("{name}.weight"), format!("{name}.bias"));
        let (operator, channels, stride, padding) = match layer.kind {
            LayerKind::Convolution(kernel) => {
                let channels = [layer.out_channels, layer.in_channels];
                ("Conv", channels, kernel.stride, kernel.padding)
            }
            LayerKind::Transposed { .. } => ("ConvTranspose", [layer.in_channels, layer.out_channels], 2, 1),
        };
        let size = layer.kind.size();
        let shape = [channels[0], channels[1], size, size];
        match self.steps.get(from) {
            Some(&input_step) if operator == "Conv" && name != OUTPUT => {
                self.quantised_weights(folded, &shape, input_step);
            }
            _ => {
                self.tensor(&weight_name, &shape, weights);
                self.tensor(&bias_name, &[layer.out_channels], bias);
            }
        }
        let (sizes, strides, pads) = ([size; 2], [stride; 2], [padding; 4]);
        let mut attributes: Vec<(&str, &[usize])> =
            vec![("kernel_shape", &sizes), ("strides", &strides), ("pads", &pads)];
        if layer.kind == (LayerKind::Transposed { size: 3 }) {
            attributes.push(("output_padding", &[1, 1]));
        }
        let inputs = [from, &weight_name, &bias_name];
        if name == OUTPUT {
            self.node(operator, &inputs, name, &attributes);
        } else {
            let sum = format!("{name}.sum");
            self.node(operator, &inputs, &sum, &attributes);
            self.node("Relu", &[&sum], name, &[]);
            return self.made(name.to_owned());
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
        self.made(name.to_owned())
    }

    fn join(&mut self, first: &str, second: &str, name: &str) -> String {
        self.node("Concat", &[first, second], name, &[("axis", &[1])]);
        self.made(name.to_owned())
    }
}

impl<'a> Graph<'a> {
    fn new(name: &str, precision: Precision<'a>) -> Self {
        Self {
            proto: Message::default().text(2, name),
            precision,
            steps: BTreeMap::new(),
        }
    }

    /// The model's bytes, with an input of this shape. ModelProto: ir_version = 1, producer_name = 2, graph = 7,
    /// opset_import = 8 (its version = 2).
    fn model(mut self, input: &[usize], output: &str) -> Vec<u8> {
        self.value(11, INPUT, input);
        self.value(12, output, &[1, 3, 20, 20]);
        Message::default()
            .int(1, 8)
            .text(2, "gripline")
            .message(7, &self.proto)
            .message(8, &Message::default().int(2, 17))
            .0
    }
}

/// The encoder–decoder's bytes. Input `input`, 1×2×88×88: difference and rest image in the network's units; output
/// `output`, 1×3×20×20, the network's units.
pub(crate) fn unet(weights: &UnetWeights, precision: Precision<'_>) -> Vec<u8> {
    let mut layers = weights.folded();
    let mut graph = Graph::new("unet", precision);
    let mut next = |graph: &mut Graph, from: &str| {
        let layer = layers.next().expect("as many layers as the architecture has");
        graph.layer(&layer, from)
    };
    let input = graph.made(INPUT.to_owned());
    let at44 = next(&mut graph, &input);
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
    graph.model(&UNET_INPUT, &output)
}

/// The bytes of the network after the tracker. Input `input`, 1×10×40×40, as `gripline_network::tracked::input` makes it; output
/// `output`, 1×3×20×20, the network's units.
pub(crate) fn tracked(weights: &TrackedWeights, precision: Precision<'_>) -> Vec<u8> {
    let mut layers = weights.folded();
    let mut graph = Graph::new("tracked", precision);
    let mut next = |graph: &mut Graph, from: &str| {
        let layer = layers.next().expect("as many layers as the architecture has");
        graph.layer(&layer, from)
    };
    let input = graph.made(INPUT.to_owned());
    let at20 = next(&mut graph, &input);
    let encoded20 = next(&mut graph, &at20);
    let at10 = next(&mut graph, &encoded20);
    let encoded10 = next(&mut graph, &at10);
    let at5 = next(&mut graph, &encoded10);
    let at5 = next(&mut graph, &at5);
    let up10 = next(&mut graph, &at5);
    let joined = graph.join(&up10, &encoded10, "joined10");
    let at10 = next(&mut graph, &joined);
    let up20 = next(&mut graph, &at10);
    let joined = graph.join(&up20, &encoded20, "joined20");
    let at20 = next(&mut graph, &joined);
    let output = next(&mut graph, &at20);
    graph.model(&TRACKED_INPUT, &output)
}
