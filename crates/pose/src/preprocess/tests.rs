use proptest::prelude::*;

use super::*;

fn spec(width: usize, height: usize) -> InputSpec {
    InputSpec {
        name: "x".to_owned(),
        width,
        height,
        dynamic: false,
        layout: Layout::Nhwc,
        dtype: ElementType::Float32,
        colour: ColourOrder::Rgb,
        mean: [0.0; 3],
        scale: [1.0; 3],
        pad: 0,
    }
}

fn floats(data: &TensorData) -> &[f32] {
    match data {
        TensorData::F32(v) => v,
        _ => panic!("expected floats"),
    }
}

/// The definition, in 64-bit floats and with no separation: what a tensor pixel covers, pixel by pixel.
fn slow((image, w, h): (&[u8], usize, usize), map: CropMap, (x, y, c): (usize, usize, usize), pad: u8) -> f64 {
    let scale = f64::from(map.scale);
    let interval = |edge: f32, i: usize| {
        let (from, to) = (f64::from(edge) + i as f64 * scale, f64::from(edge) + (i + 1) as f64 * scale);
        let (middle, half) = (f64::midpoint(from, to), (scale / 2.0).max(0.5));
        (middle - half, middle + half)
    };
    let ((x0, x1), (y0, y1)) = (interval(map.left_px, x), interval(map.top_px, y));
    let (mut sum, mut area) = (0.0, 0.0);
    for py in y0.floor() as i64..y1.ceil() as i64 {
        for px in x0.floor() as i64..x1.ceil() as i64 {
            let cover = |p: i64, from: f64, to: f64| ((p + 1) as f64).min(to) - (p as f64).max(from);
            let weight = cover(px, x0, x1) * cover(py, y0, y1);
            let inside = px >= 0 && py >= 0 && px < w as i64 && py < h as i64;
            let value = if inside { image[(py as usize * w + px as usize) * 3 + c] } else { pad };
            sum += weight * f64::from(value);
            area += weight;
        }
    }
    sum / area
}

/// Both passes round every weight by at most 1/512, and every pixel has two weights that are cut off by rounding plus one
/// for each of its neighbours: with values to 255 that is at most 255 * 2 * (taps + 1) / 512 grey levels.
fn tolerance(scale: f32) -> f64 {
    255.0 * 2.0 * (f64::from(scale.max(1.0)).ceil() + 2.0) / 512.0 / 2.0
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Judge: the definition, written out slowly.
    #[test]
    fn every_pixel_is_the_mean_of_what_it_covers(
        w in 4..40_usize, h in 4..40_usize, left in -20.0..20.0_f32, top in -20.0..20.0_f32,
        scale in 0.3..6.0_f32, pad in any::<u8>(), seed in any::<u64>(),
    ) {
        let image: Vec<u8> = (0..w * h * 3).scan(seed | 1, |s, _| {
            *s = s.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            Some((*s >> 56) as u8)
        }).collect();
        let map = CropMap { left_px: left, top_px: top, scale };
        let mut preprocessor = Preprocessor::new(&InputSpec { pad, ..spec(16, 24) });
        let view = ImageView::new(w, h, &image).unwrap();
        let data = floats(preprocessor.fill(view, map));
        for y in 0..24 {
            for x in 0..16 {
                for c in 0..3 {
                    let expected = slow((&image, w, h), map, (x, y, c), pad);
                    let got = f64::from(data[(y * 16 + x) * 3 + c]);
                    prop_assert!((got - expected).abs() <= tolerance(scale), "({x}, {y}) {got} {expected}");
                }
            }
        }
    }

    #[test]
    fn picture_and_tensor_coordinates_are_inverse(
        u in -500.0..500.0_f32, v in -500.0..500.0_f32, side in 20.0..2000.0_f32, x in 0.0..256.0_f32,
    ) {
        let map = CropMap::around(u, v, side, 256, 192);
        let (pu, pv) = map.to_picture(x, x);
        let (bx, by) = map.to_tensor(pu, pv);
        // Coordinates to 3000 px and tensor pixels down to 0.1 px: 3000 * 2^-23 / 0.1 rounds to below 0.005.
        prop_assert!((bx - x).abs() < 5e-3 && (by - x).abs() < 5e-3);
        let (cx, cy) = map.to_picture(127.5, 95.5);
        prop_assert!((cx - u).abs() < 1e-2 && (cy - v).abs() < 1e-2);
    }
}

#[test]
fn a_constant_picture_stays_exactly_constant() {
    let image = vec![200_u8; 37 * 23 * 3];
    let mut preprocessor = Preprocessor::new(&spec(16, 16));
    let map = CropMap { left_px: 2.3, top_px: 1.7, scale: 1.13 };
    let data = floats(preprocessor.fill(ImageView::new(37, 23, &image).unwrap(), map));
    assert!(data.iter().all(|v| v.to_bits() == 200.0_f32.to_bits()), "{:?}", &data[..6]);
}

#[test]
fn layouts_and_colour_orders_hold_the_same_numbers() {
    let image: Vec<u8> = (0..20 * 20 * 3).map(|i| (i * 7 % 251) as u8).collect();
    let view = ImageView::new(20, 20, &image).unwrap();
    let map = CropMap::letterbox(20, 20, 16, 16);
    let mut rgb = Preprocessor::new(&spec(16, 16));
    let rgb = floats(rgb.fill(view, map)).to_vec();
    let mut bgr = Preprocessor::new(&InputSpec {
        colour: ColourOrder::Bgr,
        layout: Layout::Nchw,
        mean: [128.0; 3],
        scale: [1.0 / 256.0; 3],
        ..spec(16, 16)
    });
    let bgr = floats(bgr.fill(view, map)).to_vec();
    for cell in 0..256 {
        for c in 0..3 {
            let expected = (rgb[cell * 3 + c] - 128.0) / 256.0;
            assert!((bgr[(2 - c) * 256 + cell] - expected).abs() < 1e-6);
        }
    }
}

#[test]
fn integers_are_rounded_and_outside_is_padding() {
    let image = vec![10_u8; 16 * 8 * 3];
    let mut p = Preprocessor::new(&InputSpec { dtype: ElementType::Int32, pad: 99, ..spec(16, 16) });
    let TensorData::I32(data) = p.fill(ImageView::new(16, 8, &image).unwrap(), CropMap::letterbox(16, 8, 16, 16))
    else {
        panic!("expected integers")
    };
    let rows: Vec<i32> = data.chunks_exact(48).map(|row| row[0]).collect();
    assert_eq!(rows, [99, 99, 99, 99, 10, 10, 10, 10, 10, 10, 10, 10, 99, 99, 99, 99]);
}

#[test]
fn a_crop_far_outside_the_picture_is_all_padding() {
    let image = vec![10_u8; 16 * 16 * 3];
    let mut p = Preprocessor::new(&InputSpec { pad: 7, ..spec(16, 16) });
    let map = CropMap { left_px: 1000.0, top_px: -1000.0, scale: 2.0 };
    let data = floats(p.fill(ImageView::new(16, 16, &image).unwrap(), map));
    assert!(data.iter().all(|v| v.to_bits() == 7.0_f32.to_bits()));
}

/// Closed forms: 100 px in the 192 px of the shorter side, and a third more in the longer one; 320 px in 256 px,
/// of which a height of 180 px leaves 24 px above and below.
#[test]
fn a_square_fills_the_shorter_side_and_a_letterbox_shows_all() {
    let map = CropMap::around(300.0, 200.0, 100.0, 256, 192);
    let (left, top) = map.to_picture(-0.5, -0.5);
    assert!((map.scale - 100.0 / 192.0).abs() < 1e-6);
    assert!((left - (300.0 - 200.0 / 3.0)).abs() < 1e-4 && (top - 150.0).abs() < 1e-4, "{left} {top}");
    let map = CropMap::letterbox(320, 180, 256, 192);
    let (x, y) = map.to_tensor(-0.5, -0.5);
    assert!((map.scale - 1.25).abs() < 1e-6 && (x + 0.5).abs() < 1e-4 && (y - 23.5).abs() < 1e-4, "{x} {y}");
}

#[test]
fn row_padding_of_the_picture_is_not_read() {
    let tight: Vec<u8> = (0..20 * 16 * 3).map(|i| (i % 255) as u8).collect();
    let mut padded = Vec::new();
    for row in tight.chunks_exact(60) {
        padded.extend_from_slice(row);
        padded.extend_from_slice(&[255; 13]);
    }
    let map = CropMap::letterbox(20, 16, 16, 16);
    let mut p = Preprocessor::new(&spec(16, 16));
    let a = floats(p.fill(ImageView::new(20, 16, &tight).unwrap(), map)).to_vec();
    let b = floats(p.fill(ImageView::with_stride(20, 16, 73, &padded).unwrap(), map)).to_vec();
    assert_eq!(a, b);
    assert!(ImageView::with_stride(20, 16, 59, &padded).is_err());
    assert!(ImageView::new(0, 4, &[]).is_err());
}

/// Judge: a new preprocessor for each fill. Rows outside the picture are kept from one fill to the next only where they are the same.
#[test]
fn nothing_of_the_picture_before_is_left() {
    let noise = |seed: usize| (0..64 * 48 * 3).map(|i| ((i * 7919 + seed * 977) >> 3) as u8).collect::<Vec<u8>>();
    let letterbox = CropMap::letterbox(64, 48, 16, 24);
    let inside = CropMap { left_px: 3.0, top_px: 2.0, scale: 1.5 };
    let beside = CropMap { left_px: 900.0, ..letterbox };
    for (layout, dtype) in [(Layout::Nhwc, ElementType::Float32), (Layout::Nchw, ElementType::Uint8)] {
        let spec = InputSpec { layout, dtype, pad: 9, ..spec(16, 24) };
        let mut kept = Preprocessor::new(&spec);
        for (i, map) in
            [letterbox, letterbox, inside, letterbox, inside, inside, beside, letterbox].into_iter().enumerate()
        {
            let picture = noise(i);
            let view = ImageView::new(64, 48, &picture).unwrap();
            assert_eq!(kept.fill(view, map), Preprocessor::new(&spec).fill(view, map), "fill {i}");
        }
        // To another size and back.
        kept.resize(8, 8);
        kept.resize(16, 24);
        let picture = noise(9);
        let view = ImageView::new(64, 48, &picture).unwrap();
        assert_eq!(kept.fill(view, letterbox), Preprocessor::new(&spec).fill(view, letterbox));
    }
}

/// Judge: the definition, where a tensor pixel covers more rows and columns than the unrolled loops, and where it covers less than
/// one.
#[test]
fn a_strong_shrink_and_an_enlargement_are_means_too() {
    let (w, h) = (230, 170);
    let image: Vec<u8> = (0..w * h * 3).map(|i| ((i * i) >> 5) as u8).collect();
    for (left_px, scale) in [(-5.3, 7.3), (-5.3, 8.0), (-5.3, 11.7), (40.3, 0.37), (-5.3, 0.9)] {
        let map = CropMap { left_px, top_px: 4.1, scale };
        let mut preprocessor = Preprocessor::new(&InputSpec { pad: 200, ..spec(16, 16) });
        let data = floats(preprocessor.fill(ImageView::new(w, h, &image).unwrap(), map));
        for (i, got) in data.iter().enumerate() {
            let expected = slow((&image, w, h), map, (i / 3 % 16, i / 48, i % 3), 200);
            assert!((f64::from(*got) - expected).abs() <= tolerance(scale), "{scale} {i}: {got} {expected}");
        }
    }
}

proptest! {
    /// Judge: `f32::round`.
    #[test]
    fn integers_are_those_of_round(bits in any::<u32>(), small in -300_i32..300, part in -2_i32..=2) {
        let near_half = f32::from_bits((small as f32 + 0.5).to_bits().wrapping_add_signed(part));
        for x in [f32::from_bits(bits), near_half, near_half * 1e4, near_half * 3e4, small as f32] {
            prop_assert_eq!(passes::half_up(x) as i32, x.round() as i32, "{}", x);
            prop_assert_eq!(passes::half_up(x) as u8, x.round() as u8, "{}", x);
        }
    }
}

/// Every memory order and element type holds the same picture, in either order of colours.
#[test]
fn every_kind_of_tensor_holds_the_same_picture() {
    let image: Vec<u8> = (0..40 * 30 * 3).map(|i| (i * 31 % 256) as u8).collect();
    let view = ImageView::new(40, 30, &image).unwrap();
    let map = CropMap::letterbox(40, 30, 16, 16);
    let mut plain = Preprocessor::new(&spec(16, 16));
    let plain = floats(plain.fill(view, map)).to_vec();
    for layout in [Layout::Nhwc, Layout::Nchw] {
        for colour in [ColourOrder::Rgb, ColourOrder::Bgr] {
            for dtype in [ElementType::Float32, ElementType::Int32, ElementType::Uint8] {
                let mut p = Preprocessor::new(&InputSpec { layout, dtype, colour, ..spec(16, 16) });
                let got: Vec<f64> = match p.fill(view, map) {
                    TensorData::F32(v) => v.iter().map(|x| f64::from(*x).round()).collect(),
                    TensorData::I32(v) => v.iter().map(|x| f64::from(*x)).collect(),
                    TensorData::U8(v) => v.iter().map(|x| f64::from(*x)).collect(),
                };
                for (cell, pixel) in plain.chunks_exact(3).enumerate() {
                    for (c, expected) in pixel.iter().enumerate() {
                        let c = if colour == ColourOrder::Bgr { 2 - c } else { c };
                        let i = if layout == Layout::Nhwc { cell * 3 + c } else { c * 256 + cell };
                        assert!(
                            (got[i] - f64::from(*expected).round()).abs() < 1e-9,
                            "{layout:?} {colour:?} {dtype:?}"
                        );
                    }
                }
            }
        }
    }
}

/// Judge: the same fill of a picture that is mirrored by hand.
#[test]
fn a_mirrored_tensor_is_that_of_the_mirrored_picture() {
    let image: Vec<u8> = (0..40 * 30 * 3).map(|i| (i * 31 % 256) as u8).collect();
    let mirrored: Vec<u8> = image
        .chunks_exact(40 * 3)
        .flat_map(|row| row.as_chunks::<3>().0.iter().rev().flatten().copied().collect::<Vec<_>>())
        .collect();
    let map = CropMap::letterbox(40, 30, 24, 32);
    for layout in [Layout::Nhwc, Layout::Nchw] {
        let mut p = Preprocessor::new(&InputSpec { layout, ..spec(24, 32) });
        let straight = p.fill(ImageView::new(40, 30, &image).unwrap(), map).clone();
        p.mirror();
        let got = p.data().clone();
        p.mirror();
        assert_eq!(p.data(), &straight);
        let expected = p.fill(ImageView::new(40, 30, &mirrored).unwrap(), map);
        for (got, expected) in floats(&got).iter().zip(floats(expected)) {
            assert!(f64::from(got - expected).abs() <= tolerance(map.scale), "{layout:?}: {got} {expected}");
        }
        assert_ne!(&got, &straight);
    }
}
