//! Writes a chain of quantised convolutions as a TensorFlow Lite file: int8 activations and filters, int32 biases, VALID
//! padding. Only what such a chain needs of the schema (tensorflow/lite/schema/schema.fbs, version 3); field numbers
//! are the schema's.

use flatbuffers::{
    FlatBufferBuilder, ForwardsUOffset, TableUnfinishedWIPOffset, VOffsetT, Vector, WIPOffset,
};

/// A quantised convolution: q_out = zero + Σ (q_in − zero_in)·q_filter·scale_in·scale_filter/scale_out + bias.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Convolution {
    pub(crate) in_channels: usize,
    /// Rows and columns of the filters.
    pub(crate) side: usize,
    /// Pixels from one output to the next, along rows and columns.
    pub(crate) stride: i32,
    /// Output channel, row, column, input channel.
    pub(crate) filters: Vec<i8>,
    /// One a output channel.
    pub(crate) filter_scales: Vec<f32>,
    /// One a output channel, in units of input scale times filter scale.
    pub(crate) biases: Vec<i32>,
    /// Negative outputs become zero.
    pub(crate) rectified: bool,
    pub(crate) output: Scale,
}

/// What a quantised number stands for: scale · (q − zero).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    pub(crate) scale: f32,
    pub(crate) zero: i8,
}

// The schema's numbers.
const TENSOR_INT32: i8 = 2;
const TENSOR_INT8: i8 = 9;
const OPERATOR_CONV_2D: i8 = 3;
const OPTIONS_CONV_2D: u8 = 1;
const PADDING_VALID: i8 = 1;
const ACTIVATION_RELU: i8 = 1;
const SCHEMA_VERSION: u32 = 3;
/// Version of CONV_2D that knows a scale for every channel of int8 filters.
const CONV_2D_VERSION: i32 = 3;

/// Number of a field to its place in the table's index.
const fn field(number: VOffsetT) -> VOffsetT {
    4 + 2 * number
}

type Bytes<'a> = FlatBufferBuilder<'a>;
type Table = WIPOffset<TableUnfinishedWIPOffset>;

struct Tensor<'a> {
    name: &'a str,
    shape: &'a [i32],
    kind: i8,
    buffer: u32,
    scales: &'a [f32],
    zero: i64,
}

type Finished = WIPOffset<flatbuffers::TableFinishedWIPOffset>;

/// What a model consists of, as far as it is written.
struct Parts {
    buffers: Vec<Finished>,
    tensors: Vec<Finished>,
    operators: Vec<Finished>,
    /// Rows and columns of the last tensor, its channels and its scale.
    side: usize,
    channels: usize,
    scale: f32,
}

impl Parts {
    /// Writes a buffer; its number.
    fn data(&mut self, bytes: &mut Bytes<'_>, data: &[u8]) -> u32 {
        self.buffers.push(buffer(bytes, data));
        self.buffers.len() as u32 - 1
    }

    /// Writes a layer's filters, biases and output, and the operator that joins them to the last tensor.
    fn layer(&mut self, bytes: &mut Bytes<'_>, number: usize, layer: &Convolution) {
        let outputs = layer.biases.len();
        let filters: Vec<u8> = layer.filters.iter().map(|&weight| weight as u8).collect();
        let filters = Tensor {
            name: &format!("filters {number}"),
            shape: &[outputs, layer.side, layer.side, self.channels].map(|size| size as i32),
            kind: TENSOR_INT8,
            buffer: self.data(bytes, &filters),
            scales: &layer.filter_scales,
            zero: 0,
        };
        self.tensors.push(tensor(bytes, &filters));
        let biases: Vec<u8> = layer.biases.iter().flat_map(|bias| bias.to_le_bytes()).collect();
        let scales: Vec<f32> = layer
            .filter_scales
            .iter()
            .map(|scale| self.scale * scale)
            .collect();
        let biases = Tensor {
            name: &format!("biases {number}"),
            shape: &[outputs as i32],
            kind: TENSOR_INT32,
            buffer: self.data(bytes, &biases),
            scales: &scales,
            zero: 0,
        };
        self.tensors.push(tensor(bytes, &biases));
        self.side = (self.side - layer.side) / layer.stride as usize + 1;
        self.channels = outputs;
        self.scale = layer.output.scale;
        self.activation(bytes, &format!("output {number}"), layer.output);
        let last = self.tensors.len() as i32 - 1;
        let inputs = [last - 3, last - 2, last - 1];
        self.operators
            .push(operator(bytes, inputs, last, layer.stride, layer.rectified));
    }

    /// Writes the tensor between two layers.
    fn activation(&mut self, bytes: &mut Bytes<'_>, name: &str, scale: Scale) {
        let activation = Tensor {
            name,
            shape: &[1, self.side, self.side, self.channels].map(|size| size as i32),
            kind: TENSOR_INT8,
            buffer: 0,
            scales: &[scale.scale],
            zero: scale.zero.into(),
        };
        self.tensors.push(tensor(bytes, &activation));
    }
}

/// The file's bytes for `chain` on a square input of `side` pixels.
pub(crate) fn file(description: &str, side: usize, input: Scale, chain: &[Convolution]) -> Vec<u8> {
    let mut bytes = Bytes::new();
    let mut parts = Parts {
        // Buffer 0 is the schema's "no data".
        buffers: vec![buffer(&mut bytes, &[])],
        tensors: Vec::new(),
        operators: Vec::new(),
        side,
        channels: chain[0].in_channels,
        scale: input.scale,
    };
    parts.activation(&mut bytes, "input", input);
    for (number, layer) in chain.iter().enumerate() {
        parts.layer(&mut bytes, number, layer);
    }
    let Parts {
        buffers,
        tensors,
        operators,
        ..
    } = parts;
    let outputs = bytes.create_vector(&[tensors.len() as i32 - 1]);
    let inputs = bytes.create_vector(&[0_i32]);
    let name = bytes.create_string("scene gate");
    let tensors = bytes.create_vector(&tensors);
    let operators = bytes.create_vector(&operators);
    let graph = bytes.start_table();
    bytes.push_slot_always(field(0), tensors);
    bytes.push_slot_always(field(1), inputs);
    bytes.push_slot_always(field(2), outputs);
    bytes.push_slot_always(field(3), operators);
    bytes.push_slot_always(field(4), name);
    let graph = finish(&mut bytes, graph);
    let graphs = bytes.create_vector(&[graph]);

    let code = bytes.start_table();
    bytes.push_slot_always(field(0), OPERATOR_CONV_2D);
    bytes.push_slot_always(field(2), CONV_2D_VERSION);
    bytes.push_slot_always(field(3), i32::from(OPERATOR_CONV_2D));
    let code = finish(&mut bytes, code);
    let codes = bytes.create_vector(&[code]);

    let description = bytes.create_string(description);
    let buffers = bytes.create_vector(&buffers);
    let model = bytes.start_table();
    bytes.push_slot_always(field(0), SCHEMA_VERSION);
    bytes.push_slot_always(field(1), codes);
    bytes.push_slot_always(field(2), graphs);
    bytes.push_slot_always(field(3), description);
    bytes.push_slot_always(field(4), buffers);
    let model = finish(&mut bytes, model);
    bytes.finish(model, Some("TFL3"));
    bytes.finished_data().to_vec()
}

fn finish(bytes: &mut Bytes<'_>, table: WIPOffset<TableUnfinishedWIPOffset>) -> Finished {
    bytes.end_table(table)
}

fn buffer(bytes: &mut Bytes<'_>, data: &[u8]) -> Finished {
    let data: Option<WIPOffset<Vector<'_, u8>>> = (!data.is_empty()).then(|| bytes.create_vector(data));
    let table = bytes.start_table();
    if let Some(data) = data {
        bytes.push_slot_always(field(0), data);
    }
    finish(bytes, table)
}

fn tensor(bytes: &mut Bytes<'_>, tensor: &Tensor<'_>) -> Finished {
    let scales = bytes.create_vector(tensor.scales);
    let zeros = bytes.create_vector(&vec![tensor.zero; tensor.scales.len()]);
    let quantisation: Table = bytes.start_table();
    bytes.push_slot_always(field(2), scales);
    bytes.push_slot_always(field(3), zeros);
    // Scales differ along the first dimension.
    bytes.push_slot_always(field(6), 0_i32);
    let quantisation = finish(bytes, quantisation);
    let shape = bytes.create_vector(tensor.shape);
    let name = bytes.create_string(tensor.name);
    let table = bytes.start_table();
    bytes.push_slot_always(field(0), shape);
    bytes.push_slot_always(field(1), tensor.kind);
    bytes.push_slot_always(field(2), tensor.buffer);
    bytes.push_slot_always(field(3), name);
    bytes.push_slot_always(field(4), quantisation);
    finish(bytes, table)
}

fn operator(bytes: &mut Bytes<'_>, inputs: [i32; 3], output: i32, stride: i32, rectified: bool) -> Finished {
    let inputs: WIPOffset<Vector<'_, i32>> = bytes.create_vector(&inputs);
    let outputs = bytes.create_vector(&[output]);
    let options = bytes.start_table();
    bytes.push_slot_always(field(0), PADDING_VALID);
    bytes.push_slot_always(field(1), stride);
    bytes.push_slot_always(field(2), stride);
    bytes.push_slot_always(field(3), if rectified { ACTIVATION_RELU } else { 0 });
    bytes.push_slot_always(field(4), 1_i32);
    bytes.push_slot_always(field(5), 1_i32);
    let options = finish(bytes, options);
    let table = bytes.start_table();
    bytes.push_slot_always(field(0), 0_u32);
    bytes.push_slot_always(field(1), inputs);
    bytes.push_slot_always(field(2), outputs);
    bytes.push_slot_always(field(3), OPTIONS_CONV_2D);
    bytes.push_slot_always(field(4), WIPOffset::<ForwardsUOffset<()>>::new(options.value()));
    finish(bytes, table)
}
