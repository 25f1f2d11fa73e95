//! The hashes of the types that Telltale publishes and serves (REP 2016): others find them by it.

/// Humble writes this in place of a hash.
pub const NONE: &str = "TypeHashNotSupported";

/// By the type as it is on the wire. A type that the configuration names alone has the hash of its subscribers.
const HASHES: [(&str, &str); 10] = [
    (
        "diagnostic_msgs::msg::dds_::DiagnosticArray_",
        "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    ),
    (
        "diagnostic_msgs::msg::dds_::DiagnosticStatus_",
        "RIHS01_b0e3e692ea2d54a8af2f4ef1930e81556a2db55216b771f8a7d2724ed47bf0e4",
    ),
    (
        "diagnostic_msgs::srv::dds_::AddDiagnostics_",
        "RIHS01_6b91084c9f8bffd9b0c1f6883e0e8e491a831f4fc6c6aec77a4efaf3f1ea90b5",
    ),
    (
        "geometry_msgs::msg::dds_::AccelStamped_",
        "RIHS01_ef1df9eabae0a708cc049a061ebcddc4e2a5f745730100ba680e086a9698b165",
    ),
    (
        "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
        "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    ),
    (
        "lifecycle_msgs::srv::dds_::GetState_",
        "RIHS01_800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795",
    ),
    (
        "rcl_interfaces::msg::dds_::Log_",
        "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
    ),
    ("std_msgs::msg::dds_::Bool_", "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9"),
    (
        "std_msgs::msg::dds_::String_",
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    ),
    (
        "std_srvs::srv::dds_::Trigger_",
        "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    ),
];

/// The hash of a type.
pub fn of(type_name: &str) -> &'static str {
    HASHES.iter().find(|(known, _)| *known == type_name).map_or(NONE, |(_, hash)| hash)
}
