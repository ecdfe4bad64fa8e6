//! Small matrices of fixed size, whose sums are always taken in the same order.

/// Three numbers: (x, y, θ), or along and across and turn.
pub type Vector = [f64; 3];
/// Three rows of three.
pub type Matrix = [[f64; 3]; 3];

/// All zero.
pub const ZERO: Matrix = [[0.0; 3]; 3];

/// With these on the diagonal.
#[must_use]
pub const fn diagonal(of: Vector) -> Matrix {
    [[of[0], 0.0, 0.0], [0.0, of[1], 0.0], [0.0, 0.0, of[2]]]
}

/// A B.
#[must_use]
pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut c = ZERO;
    for row in 0..3 {
        for column in 0..3 {
            c[row][column] = a[row][0] * b[0][column] + a[row][1] * b[1][column] + a[row][2] * b[2][column];
        }
    }
    c
}

/// Aᵀ B.
#[must_use]
pub fn transposed_product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut c = ZERO;
    for row in 0..3 {
        for column in 0..3 {
            c[row][column] = a[0][row] * b[0][column] + a[1][row] * b[1][column] + a[2][row] * b[2][column];
        }
    }
    c
}

/// Aᵀ.
#[must_use]
pub fn transpose(a: &Matrix) -> Matrix {
    [[a[0][0], a[1][0], a[2][0]], [a[0][1], a[1][1], a[2][1]], [a[0][2], a[1][2], a[2][2]]]
}

/// A v.
#[must_use]
pub fn apply(a: &Matrix, v: &Vector) -> Vector {
    [0, 1, 2].map(|row| a[row][0] * v[0] + a[row][1] * v[1] + a[row][2] * v[2])
}

/// Aᵀ v.
#[must_use]
pub fn apply_transposed(a: &Matrix, v: &Vector) -> Vector {
    [0, 1, 2].map(|column| a[0][column] * v[0] + a[1][column] * v[1] + a[2][column] * v[2])
}

/// A + B.
#[must_use]
pub fn sum(a: &Matrix, b: &Matrix) -> Matrix {
    let mut c = *a;
    add(&mut c, b);
    c
}

/// A ← A + B.
pub fn add(a: &mut Matrix, b: &Matrix) {
    for row in 0..3 {
        for column in 0..3 {
            a[row][column] += b[row][column];
        }
    }
}

/// s A.
#[must_use]
pub fn scaled(a: &Matrix, s: f64) -> Matrix {
    a.map(|row| row.map(|value| value * s))
}

/// vᵀ A v.
#[must_use]
pub fn quadratic(a: &Matrix, v: &Vector) -> f64 {
    let w = apply(a, v);
    v[0] * w[0] + v[1] * w[1] + v[2] * w[2]
}

/// A⁻¹ of a symmetric matrix that is positive definite. What is singular gives what is not finite.
#[must_use]
pub fn inverse(m: &Matrix) -> Matrix {
    let minor = |a: usize, b: usize, c: usize, d: usize| m[a][b] * m[c][d] - m[a][d] * m[c][b];
    let (c00, c01, c02) = (minor(1, 1, 2, 2), -minor(1, 0, 2, 2), minor(1, 0, 2, 1));
    let scale = 1.0 / (m[0][0] * c00 + m[0][1] * c01 + m[0][2] * c02);
    scaled(
        &[
            [c00, -minor(0, 1, 2, 2), minor(0, 1, 1, 2)],
            [c01, minor(0, 0, 2, 2), -minor(0, 0, 1, 2)],
            [c02, -minor(0, 0, 2, 1), minor(0, 0, 1, 1)],
        ],
        scale,
    )
}

/// (A + Aᵀ)/2.
#[must_use]
pub fn symmetric(a: &Matrix) -> Matrix {
    scaled(&sum(a, &transpose(a)), 0.5)
}

/// R A Rᵀ with R the turn by `theta_rad` of the first two.
#[must_use]
pub fn turned(a: &Matrix, theta_rad: f64) -> Matrix {
    let (s, c) = libm::sincos(theta_rad);
    let r = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]];
    product(&product(&r, a), &transpose(&r))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn an_inverse_undoes(values in prop::array::uniform9(-2.0..2.0f64)) {
            let a = [[values[0], values[1], values[2]], [values[3], values[4], values[5]], [values[6], values[7], values[8]]];
            let definite = sum(&transposed_product(&a, &a), &diagonal([0.1; 3]));
            let one = product(&definite, &inverse(&definite));
            for (row, line) in one.iter().enumerate() {
                for (column, value) in line.iter().enumerate() {
                    prop_assert!((value - f64::from(u8::from(row == column))).abs() < 1e-9);
                }
            }
        }
    }
}
