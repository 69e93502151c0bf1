//! The training loss, in the network's output units, weighted per sample so that light touches count as much
//! as heavy grips: relative squared force error, plus the error of f_T − μ f_z in loaded taxels (what the
//! detector's decision hangs on), plus the error of the summed force.

use burn::tensor::Tensor;

use crate::constants::{
    CONE_LOADED, CONE_WEIGHT, DETECTOR_FRICTION, LOSS_FLOOR, SHEAR_WEIGHT, TOTAL_FLOOR, TOTAL_WEIGHT,
};

/// Squared shear added under the square root, so that its slope at zero shear is finite.
const SHEAR_FLOOR: f32 = 1e-3;

/// The loss of a batch: predicted and true `[batch, 3, 20, 20]` to `[1]`.
pub(crate) fn loss(predicted: Tensor<4>, truth: Tensor<4>) -> Tensor<1> {
    let over_map = |tensor: Tensor<4>| tensor.mean_dims(&[1, 2, 3]);
    let weight = over_map(truth.clone().square()).add_scalar(LOSS_FLOOR).recip();

    let error = (predicted.clone() - truth.clone()).square();
    let shear = over_map(error.clone().narrow(1, 0, 2)).mul_scalar(SHEAR_WEIGHT * 2.0 / 3.0);
    let force = shear + over_map(error.narrow(1, 2, 1)).div_scalar(3.0);

    let loaded = truth.clone().narrow(1, 2, 1).greater_scalar(CONE_LOADED).float();
    let cone_error = cone(predicted.clone()) - cone(truth.clone());
    let cone = over_map(cone_error.square() * loaded);

    let sum = |tensor: Tensor<4>| tensor.sum_dims(&[2, 3]);
    let total_error = (sum(predicted) - sum(truth.clone())).square().sum_dim(1);
    let total = total_error / sum(truth).square().sum_dim(1).add_scalar(TOTAL_FLOOR);

    ((force + cone.mul_scalar(CONE_WEIGHT)) * weight + total.mul_scalar(TOTAL_WEIGHT)).mean()
}

/// f_T − μ f_z per taxel.
fn cone(map: Tensor<4>) -> Tensor<4> {
    let shear = map
        .clone()
        .narrow(1, 0, 2)
        .square()
        .sum_dim(1)
        .add_scalar(SHEAR_FLOOR)
        .sqrt();
    shear - map.narrow(1, 2, 1).mul_scalar(DETECTOR_FRICTION)
}
